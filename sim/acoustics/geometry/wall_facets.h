// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/folded_planes.h"
#include "sim/acoustics/geometry/mirror_planes.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A connected part of a mirror plane, or a fold, as the smallest rectangle about it of a few directions: one piece of furniture's front,
/// where the plane holds those of several.
struct WallFacet {
  /// How the surface goes on beyond a side.
  enum class Side : std::uint8_t {
    sheet,    ///< it ends in the air, and so does its back
    solid,    ///< it ends in the air, at another face of a body
    joined,   ///< another surface stands there, as the floor does below a wall; a gap of 5 cm counts as none
    endless,  ///< it goes on in its plane, in another facet
  };
  std::array<glm::dvec3, 2> axis{};            ///< unit, in the plane, at right angles
  std::array<double, 2> lower_m{}, upper_m{};  ///< dot(axis, x) of its sides
  glm::dvec3 normal{0};                        ///< unit: that of its plane
  double area_m2 = 0;                          ///< of its triangles, which may fill the rectangle in part
  /// By the facing (0: along the normal), the axis and the end (0: lower).
  std::array<std::array<std::array<Side, 2>, 2>, 2> side{};

  /// The facet about a point of it as its free sides are, seen from one facing: a floor that a cabinet stands on shows its front once more,
  /// upside down.
  struct View {
    std::array<std::array<double, 2>, 2> to_side_m{};  ///< by axis and end; infinite where no free side is
    std::array<std::array<double, 2>, 2> weight{};     ///< of an edge there: 1 of a sheet, 2/3 of a solid (wall_power.h)
    std::array<double, 2> length_m{};                  ///< with what is mirrored
    bool ends = false;                                 ///< is there a free side?
  };
  [[nodiscard]] View view(glm::dvec3 point, bool along_normal) const;
  /// Does a point of its plane lie on it, or beyond a side at which it goes on?  5 cm off a side count as on it.
  [[nodiscard]] bool reaches(glm::dvec3 point) const;
};

/// Facets of the planes and folds of a scene.  Immutable.
class WallFacets {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  /// Of all connected parts of at least `least_m2` of the planes and folds, the `most` largest.  About 0.5 us per triangle, and 10 us per
  /// facet: up to 48 rays look at what its sides end at.
  WallFacets(const Scene& scene, std::span<const MirrorPlane> planes, std::span<const std::uint32_t> plane_of_triangle,
             const FoldedPlanes& folds, double least_m2, std::size_t most);
  /// Of the plane of a triangle; null: too small.
  [[nodiscard]] const WallFacet* of_triangle(std::uint32_t triangle) const { return find(of_triangle_[triangle]); }
  [[nodiscard]] const WallFacet* of_fold(std::uint32_t fold) const { return find(of_fold_[fold]); }
  [[nodiscard]] std::span<const WallFacet> all() const { return facets_; }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(facets_) + bytes_of(of_triangle_) + bytes_of(of_fold_); }

 private:
  [[nodiscard]] const WallFacet* find(std::uint32_t facet) const { return facet == kNone ? nullptr : &facets_[facet]; }
  std::vector<WallFacet> facets_;
  std::vector<std::uint32_t> of_triangle_, of_fold_;
};

}  // namespace earshot
