// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/nav/surface.h"

namespace earshot {

/// A corner around which shortest paths bend: a border vertex where the surface takes up more than half a turn.
struct Corner {
  glm::dvec3 position;           ///< a millimetre off the vertex, inside the surface
  glm::dvec3 wall_in, wall_out;  ///< from the vertex along its two walls, unit, horizontal
  int polygon = 0;
  int island = 0;
};

/// Whether a shortest path can run through `corner` along `direction` (unit, horizontal): only if both walls lie to the same side:
/// otherwise it heads into the obstacle, or the bend could be cut.  `slack`: sine allowed on the wrong side.
bool is_tangent(const Corner& corner, glm::dvec3 direction, double slack);

/// Visibility graph of the corners (Lozano-Perez and Wesley 1979, "An algorithm for planning collision-free paths among
/// polyhedral obstacles"), only edges that are tangent at both ends.  Shortest paths on a plane with holes bend at such corners only.
class CornerGraph {
 public:
  struct Edge {
    std::uint32_t to;
    double length_m;
  };

  CornerGraph() = default;
  explicit CornerGraph(const Surface& surface);

  [[nodiscard]] std::span<const Corner> corners() const { return corners_; }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(corners_) + bytes_of(first_edge_) + bytes_of(edges_); }  ///< of memory
  [[nodiscard]] std::span<const Edge> edges_of(std::uint32_t corner) const {
    return std::span(edges_).subspan(first_edge_[corner], first_edge_[corner + 1] - first_edge_[corner]);
  }

 private:
  std::vector<Corner> corners_;
  std::vector<std::size_t> first_edge_;
  std::vector<Edge> edges_;
};

/// Sine allowed on the wrong side of a tangent over `distance_m`: corners stand off their vertices.
double tangent_slack(double distance_m);

}  // namespace earshot
