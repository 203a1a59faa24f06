// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// Triangles that simplification removed, and the largest shift of the surface.
struct SimplifyReport {
  std::uint64_t triangles_before = 0, triangles_after = 0;
  /// Largest distance of a vertex of the original from the simplified surface of the same material and object, measured on up to 512 evenly
  /// spaced vertices of each; 0 if nothing was taken away.
  double deviation_m = 0;
};

/// Why a surface has its material: the rules of material_assignment.h, by number.
enum class MaterialReason : std::uint8_t {
  pattern,         ///< 1 to 4: of `assign`
  category,        ///< 5: of `semantics`
  own,             ///< 6: of a generated scene
  chosen_default,  ///< 7: `default_material`
  label,           ///< 8: a name or label of the database
  fallback,        ///< 9: nothing names a material
};

/// How a material slot of the mesh came to its material.
struct MaterialChoice {
  MaterialReason reason = MaterialReason::own;
  std::string by = {};        ///< the pattern, category or name that decided; empty with the last
  bool has_category = false;  ///< whether `semantics`, if given, know its mesh material or its node
};

/// How the coordinates of a mesh file were read.
struct FileAxes {
  double unit_m = 1;
  char up = 'y';                                    ///< or z
  bool is_unit_given = false, is_up_given = false;  ///< by the user; otherwise they are the defaults
};

/// How a point cloud became a closed surface.
struct CloudReport {
  std::uint64_t points = 0;          ///< of the file
  std::uint64_t invalid_points = 0;  ///< left out: a coordinate that is not finite, or withheld (LAS)
  std::uint64_t stray_points = 0;    ///< left out: far from the surfaces
  double cell_m = 0;                 ///< edge of a voxel
  bool is_cell_given = false;        ///< by the user; otherwise from the spacing
  double spacing_m = 0;              ///< median distance of a point from its nearest neighbour; 0 if the cell was given
  double closed_width_m = 0;         ///< openings up to this width were closed
  std::uint64_t holes = 0;           ///< closed ones of nine voxels and more
  double hole_area_m2 = 0;           ///< of all closed places, gaps between points among them
  double air_m3 = 0;                 ///< enclosed by the surface
  double unseen_m3 = 0;              ///< within the bounds, neither that air nor outside: behind surfaces, in walls and furniture
};

/// What import repaired, as counts, and what it found odd, one line each (unmatched pattern, suspicious size, lowered transmission).
struct ImportReport {
  std::uint64_t triangles_read = 0, degenerate_removed = 0, duplicate_removed = 0, vertices_welded = 0;
  std::optional<SimplifyReport> simplified;  ///< if the scene was simplified
  std::vector<std::string> warnings;
  std::vector<MaterialChoice> choices;  ///< per material slot of the mesh; empty where nothing was assigned
  bool has_semantics = false;           ///< whether categories play a part
  std::optional<FileAxes> axes;         ///< of a mesh file
  std::optional<CloudReport> cloud;     ///< of a point cloud
};

}  // namespace earshot
