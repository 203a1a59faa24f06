// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/base/memory_bytes.h"

namespace earshot {

/// An edge at which a reflecting plane ends in the air.
struct PanelEdge {
  glm::dvec3 start{0}, along{0}, outward{0};  ///< unit vectors; outward: in the plane, away from it
  glm::dvec3 normal{0};                       ///< unit, of the face that ends here, into the air: the other side may go on
  double length_m = 0;
  double exterior_rad = 0, other_width_m = 0;  ///< angle of the air; how far the other face goes on (DiffractionEdge)
  std::uint32_t edge = 0;                      ///< among the DiffractionEdges
  bool is_first_face = false;                  ///< of that edge
};

/// The free edges of each mirror plane: those of DiffractionEdges with 195 degrees of air and more, by the planes of their faces.  Walls
/// that meet other walls have none.  Immutable.
class PanelEdges {
 public:
  /// About 2 us per edge: a ray tells which plane each face lies in.
  PanelEdges(const Scene& scene, const DiffractionEdges& edges, std::span<const std::uint32_t> plane_of_triangle, std::size_t num_planes);
  [[nodiscard]] std::span<const PanelEdge> of(std::uint32_t plane) const {
    return std::span(edges_).subspan(begin_[plane], begin_[plane + 1] - begin_[plane]);
  }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(begin_) + bytes_of(edges_); }  ///< of memory

 private:
  std::vector<std::size_t> begin_;
  std::vector<PanelEdge> edges_;  ///< by plane
};

}  // namespace earshot
