// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace earshot {

struct GltfPrimitive;

/// Category of a surface, and the instance that it belongs to ("chair", "chair_12").
struct SurfaceName {
  std::string category, object;
};

/// Names of surfaces that a file beside the mesh gives, by the numbers or the colours that the mesh carries.
class SurfaceNames {
 public:
  SurfaceNames() = default;
  SurfaceNames(const SurfaceNames&) = delete;
  SurfaceNames& operator=(const SurfaceNames&) = delete;
  virtual ~SurfaceNames() = default;
  /// After the first call of one of the others.
  [[nodiscard]] virtual const std::vector<SurfaceName>& all() const = 0;
  /// Indices into all(), one per triangle of a PLY file.  ids: the number that the face of the triangle carries.
  [[nodiscard]] virtual std::vector<std::uint32_t> of_faces(std::span<const std::int64_t> ids) = 0;
  /// Indices into all(), one per triangle of a primitive.  Throws InputError for what is damaged.
  [[nodiscard]] virtual std::vector<std::uint32_t> of_primitive(const GltfPrimitive& primitive) = 0;
};

}  // namespace earshot
