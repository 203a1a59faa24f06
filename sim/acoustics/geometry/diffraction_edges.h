// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/edge_sight.h"
#include "sim/scene/scene.h"

namespace earshot {

/// Wedges with less air, 195 degrees, behave as a plane where they reflect: images in their two faces overlap and gap by turns, and are
/// that of a plane in the mean.  So they bound no panel and take no part in reflections.
inline constexpr double kBluntRad = std::numbers::pi * 195.0 / 180.0;

/// Faces are followed no further.
inline constexpr double kWideFaceM = 10.24;

/// A straight edge that diffracts sound: a wedge of air of more than 185 degrees between two faces.  Lengths in metres, world axes.
struct DiffractionEdge {
  glm::dvec3 start{0}, along{0};  ///< along: unit
  double length_m = 0;
  glm::dvec3 face{0};           ///< unit, from the edge into its first face
  glm::dvec3 first_normal{0};   ///< unit, of the first face, into the air: `face` turned by 90 degrees about `along`
  glm::dvec3 second_normal{0};  ///< unit, of the second face, into the air
  double exterior_rad = 0;      ///< angle of the air, in (pi, 2 pi]; 2 pi: the rim of a sheet
  std::uint32_t first_material = 0, second_material = 0;
  /// How far the faces go on from the middle of the edge, by an eighth of it; kWideFaceM: that far or further, or not known.
  double first_width_m = kWideFaceM, second_width_m = kWideFaceM;

  [[nodiscard]] glm::dvec3 at(double along_m) const { return start + along_m * along; }
  /// Angle from the first face through the air, in [0, exterior]; a point inside the solid is moved to the nearer face.
  [[nodiscard]] double angle_of(glm::dvec3 point) const;
  /// Is `point` outside the solid, or at most `tolerance_m` inside?  The solid is what lies behind both faces.
  [[nodiscard]] bool in_air(glm::dvec3 point, double tolerance_m) const {
    const glm::dvec3 from = point - start;
    return glm::dot(from, first_normal) >= -tolerance_m || glm::dot(from, second_normal) >= -tolerance_m;
  }
  /// Unit, into the middle of the air, halfway between the faces.
  [[nodiscard]] glm::dvec3 outward() const;
  /// Unit, from the edge into its second face.
  [[nodiscard]] glm::dvec3 second_face() const;
};

/// The edges of a scene.  Immutable but for what it remembers of visibility, which no answer depends on; safe from any thread.
///
/// Faces meet at an edge if they share its two vertices (equal positions, whatever the indices); any number may.  Neither winding nor which
/// side is solid matters: every sector between neighbouring faces that is wider than 185 degrees is an edge, on both sides of a wall, and
/// visibility decides whether sound gets there.  The rim of an open sheet is a half plane.  Straight runs of pieces (within 1 degree, faces
/// within 3) become one edge, pieces shorter than `least_length_m` are dropped afterwards.  Rays close to the edge (by 5 % of its length,
/// at most 5e-4 of the scene's diagonal) then find faces that touch it without sharing vertices: a wall that stands on the floor has
/// no rim there.
class DiffractionEdges {
 public:
  /// Keeps a reference to the rays of `scene`, which must outlive this.  About 1 us per triangle and, at 6,500 edges, 10 us per edge, two
  /// dozen short rays among it; the latter grows with their number (each is compared with the longer ones).
  DiffractionEdges(const Scene& scene, float least_length_m);
  /// The same with the edges that another one found in the same scene.
  DiffractionEdges(const Scene& scene, std::vector<DiffractionEdge> known);

  [[nodiscard]] std::span<const DiffractionEdge> edges() const { return edges_; }
  [[nodiscard]] const DiffractionEdge& operator[](std::uint32_t edge) const { return edges_[edge]; }
  [[nodiscard]] std::size_t size() const { return edges_.size(); }
  [[nodiscard]] std::size_t bytes() const;  ///< of memory
  /// Is some point of one edge visible from some point of the other?  Up to five pairs of points are tried, once: the answer is remembered
  /// (edge_sight.h).
  [[nodiscard]] bool mutually_visible(std::uint32_t edge, std::uint32_t other) const;
  /// A point of the edge moved into the air by `clearance_m()`, from where rays can leave it.
  [[nodiscard]] glm::vec3 air_point(std::uint32_t edge, double along_m) const {
    return glm::vec3(edges_[edge].at(along_m) + clearance_m_ * outward_[edge]);
  }
  /// The same, of the nearest point that is twice `clearance_m()` from both ends, or of the middle of a shorter edge.
  [[nodiscard]] glm::vec3 inset_air_point(std::uint32_t edge, double along_m) const {
    const double length_m = edges_[edge].length_m, inset_m = std::min(2.0 * clearance_m_, 0.5 * length_m);
    return air_point(edge, std::clamp(along_m, inset_m, length_m - inset_m));
  }
  [[nodiscard]] double clearance_m() const { return clearance_m_; }
  /// Is some point of the edge visible from `point`?  Five points of it are tried.  The geometry that last blocked them is tried first,
  /// which speeds up a moving point and changes no answer.
  [[nodiscard]] bool visible_from(std::uint32_t edge, glm::vec3 point) const;

  /// Edges that are known not to be visible from `edge`, a bit each of eight from 8 * group on: mutually_visible would say no.
  [[nodiscard]] std::uint32_t known_hidden(std::uint32_t edge, std::uint32_t group) const { return sight_->known_hidden(edge, group); }

 private:
  [[nodiscard]] bool find_mutually_visible(std::uint32_t edge, std::uint32_t other) const;

  const EmbreeScene* rays_;
  double clearance_m_ = 0;
  std::vector<DiffractionEdge> edges_;
  std::vector<glm::dvec3> outward_;
  std::shared_ptr<const EdgeSight> sight_;  ///< shared by copies
};

}  // namespace earshot
