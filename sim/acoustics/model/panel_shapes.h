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
#include "sim/scene/scene.h"

namespace earshot {

/// Panels whose shorter side is below this or above kWideFaceM are left to their edges (finite_edge.h).
inline constexpr double kLeastPanelM = 0.35;

/// One side of a panel that ends in the air all round: a rectangle, about.
///
/// Or of a thin panel that stands on another surface, its base, at a right angle (a balcony front, a rib of a coffer, a screen).  Its
/// rectangle is the panel and its mirror image in the base: rigid surfaces at right angles have the field of the doubled panel alone, from
/// the source and from its image in the base.  Where it ends at walls beside it too, it goes on by its length there.
struct PanelShape {
  static constexpr std::uint32_t kNone = 0xffffffffU;

  glm::dvec3 centre{0}, normal{0};      ///< normal: unit, into the air
  std::array<glm::dvec3, 2> axis{};     ///< unit, in the plane, at right angles
  std::array<double, 2> half_side_m{};  ///< along each axis
  std::uint32_t plane = 0;              ///< mirror plane that it lies in
  bool is_sheet = false;                ///< thin against its sides, so that sound passes round it: not the face of a solid
  /// Of a rigid sheet that is small against the wave: its wave is this times the wavenumber times Kirchhoff's.  The exact value of an
  /// ellipse of the same sides (Rayleigh 1897, Phil. Mag. 44, 28-52), within 5 % for a strip and for a square.
  double low_ratio_m = 0;
  /// Standing panels: the mirror planes of the base and of the panel's other side, and the panel of the base, kNone: it has no free edges.
  std::uint32_t base_plane = kNone, base_panel = kNone, back_plane = kNone;
  glm::dvec3 up{0};  ///< unit, from the base along the panel, whose centre is at the base

  [[nodiscard]] bool stands() const { return base_plane != kNone; }
  /// Mirrored in the base.
  [[nodiscard]] glm::dvec3 in_base(glm::dvec3 point) const { return point - 2.0 * glm::dot(point - centre, up) * up; }
  /// Mirrored in the panel.
  [[nodiscard]] glm::dvec3 mirrored(glm::dvec3 point) const { return point - 2.0 * glm::dot(point - centre, normal) * normal; }
  [[nodiscard]] double height_m() const { return half_side_m[1]; }  ///< of a standing panel: `up` is axis[1]
  [[nodiscard]] double area_m2() const { return 4.0 * half_side_m[0] * half_side_m[1]; }
  /// The point of the panel that is nearest to a point of its plane.
  [[nodiscard]] glm::dvec3 nearest(glm::dvec3 point) const;
  /// Does a point of its plane lie on the panel?
  [[nodiscard]] bool holds(glm::dvec3 point) const;
  /// Is a point in front of its plane, by a millimetre at least?
  [[nodiscard]] bool faces(glm::dvec3 point) const { return glm::dot(point - centre, normal) > 1e-3; }
};

/// The panels of a scene: planes, or parts of planes, whose free edges close to about a rectangle with a shorter side of kLeastPanelM to
/// kWideFaceM; and thin ones that stand on another surface.
/// Immutable.
class PanelShapes {
 public:
  static constexpr std::uint32_t kNone = PanelShape::kNone;
  /// with_standing: false leaves out panels that stand on another surface, where reflections before and after edges (edge_reflections.h)
  /// are what their rims do to its image.  A few us per panel, and half a dozen rays for one that may stand.
  PanelShapes(const Scene& scene, const PanelEdges& edges, std::span<const std::uint32_t> plane_of_triangle, std::size_t num_planes,
              std::size_t num_edges, bool with_standing);
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
  /// Keeps one of two panels that end at each other.  Where two sides share a plane, the other side of one that stands, and of a base, is
  /// one too.
  void add_backs(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle);
  /// Whether a base is in the air beyond its four ends on its own side, panels that stand on it apart: the floor of a room is not.
  [[nodiscard]] bool ends_in_air(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle, const PanelShape& base) const;
  /// By plane.
  void sort(std::size_t num_planes);
  void find_bases();

  std::vector<PanelShape> shapes_;            ///< by plane
  std::vector<std::size_t> begin_;            ///< by plane
  std::vector<std::uint32_t> panel_of_face_;  ///< by edge and face; empty without panels
};

}  // namespace earshot
