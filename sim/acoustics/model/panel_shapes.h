// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/panel_edges.h"

namespace earshot {

/// Panels whose shorter side is below this or above kWideFaceM are left to their edges (finite_edge.h).
inline constexpr double kLeastPanelM = 0.35;

/// One side of a panel that ends in the air all round: a rectangle, about.
struct PanelShape {
  glm::dvec3 centre{0}, normal{0};      ///< normal: unit, into the air
  std::array<glm::dvec3, 2> axis{};     ///< unit, in the plane, at right angles
  std::array<double, 2> half_side_m{};  ///< along each axis
  std::uint32_t plane = 0;              ///< mirror plane that it lies in
  bool is_sheet = false;                ///< thin against its sides, so that sound passes round it: not the face of a solid
  /// Of a rigid sheet that is small against the wave: its wave is this times the wavenumber times Kirchhoff's.  The exact value of an
  /// ellipse of the same sides (Rayleigh 1897, Phil. Mag. 44, 28-52), within 5 % for a strip and for a square.
  double low_ratio_m = 0;

  [[nodiscard]] double area_m2() const { return 4.0 * half_side_m[0] * half_side_m[1]; }
  /// The point of the panel that is nearest to a point of its plane.
  [[nodiscard]] glm::dvec3 nearest(glm::dvec3 point) const;
  /// Does a point of its plane lie on the panel?
  [[nodiscard]] bool holds(glm::dvec3 point) const;
  /// Is a point in front of its plane, by a millimetre at least?
  [[nodiscard]] bool faces(glm::dvec3 point) const { return glm::dot(point - centre, normal) > 1e-3; }
};

/// The panels of a scene: planes, or parts of planes, whose free edges close to about a rectangle with a shorter side of kLeastPanelM to
/// kWideFaceM.
/// Immutable.
class PanelShapes {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  /// A few us per panel.
  PanelShapes(const PanelEdges& edges, std::size_t num_planes, std::size_t num_edges);
  [[nodiscard]] std::span<const PanelShape> all() const { return shapes_; }
  /// The panel of a plane that a point of the plane lies on, on the side of `from`; null: none.
  [[nodiscard]] const PanelShape* find(std::uint32_t plane, glm::dvec3 point, glm::dvec3 from) const;
  /// Indices of at most `most` panels that a source in front of them sees, those first that fill the largest angle, about.  Walls in
  /// between count as air.
  [[nodiscard]] std::vector<std::uint32_t> largest_from(glm::dvec3 source, std::size_t most) const;
  /// Index of the panel that the first or second face of a diffracting edge belongs to; kNone: none.
  [[nodiscard]] std::uint32_t of_face(std::uint32_t edge, bool first) const {
    return panel_of_face_.empty() ? kNone : panel_of_face_[2 * edge + (first ? 0 : 1)];
  }
  [[nodiscard]] std::size_t bytes() const;  ///< of memory

 private:
  void add(std::span<const PanelEdge> sides, std::span<const std::size_t> members, std::uint32_t plane);

  std::vector<PanelShape> shapes_;            ///< by plane
  std::vector<std::size_t> begin_;            ///< by plane
  std::vector<std::uint32_t> panel_of_face_;  ///< by edge and face; empty without panels
};

}  // namespace earshot
