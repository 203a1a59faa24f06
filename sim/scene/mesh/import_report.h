#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// What simplification took away and how far it moved the surface.
struct SimplifyReport {
  std::uint64_t triangles_before = 0, triangles_after = 0;
  /// Largest distance of a vertex of the original from the simplified surface of the same material and object, measured on up to 512 evenly
  /// spaced vertices of each; 0 if nothing was taken away.
  double deviation_m = 0;
};

/// What import repaired, as counts, and what it found odd, one line each (unmatched pattern, suspicious size, lowered transmission).
struct ImportReport {
  std::uint64_t triangles_read = 0, degenerate_removed = 0, duplicate_removed = 0, vertices_welded = 0;
  std::optional<SimplifyReport> simplified;  ///< if the scene was simplified
  std::vector<std::string> warnings;
};

}  // namespace earshot
