// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/panel_edges.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace earshot {

PanelEdges::PanelEdges(const Scene& scene, const DiffractionEdges& edges, std::span<const std::uint32_t> plane_of_triangle,
                       std::size_t num_planes)
    : begin_(num_planes + 1, 0) {
  std::vector<std::pair<std::uint32_t, PanelEdge>> found;
  for (std::uint32_t index = 0; index < edges.size(); ++index) {
    const DiffractionEdge& edge = edges[index];
    if (edge.exterior_rad < kBluntRad) continue;
    const glm::dvec3 middle = edge.at(0.5 * edge.length_m);
    for (const bool first : {true, false}) {
      const glm::dvec3 face = first ? edge.face : edge.second_face(), normal = first ? edge.first_normal : edge.second_normal;
      const double width_m = first ? edge.first_width_m : edge.second_width_m;
      const double inset_m = std::min({0.02 * edge.length_m, 200.0 * edges.clearance_m(), 0.25 * width_m});
      const Hit hit =
          scene.rays().intersect(glm::vec3(middle + inset_m * (face + normal)), glm::vec3(-normal), static_cast<float>(2 * inset_m));
      if (!hit.valid() || std::abs(glm::dot(glm::dvec3(hit.normal), normal)) < 0.999) continue;
      found.push_back({plane_of_triangle[hit.triangle],
                       {.start = edge.start,
                        .along = edge.along,
                        .outward = -face,
                        .normal = normal,
                        .length_m = edge.length_m,
                        .exterior_rad = edge.exterior_rad,
                        .other_width_m = first ? edge.second_width_m : edge.first_width_m,
                        .edge = index,
                        .is_first_face = first}});
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [plane, edge] : found) {
    ++begin_[plane + 1];
    edges_.push_back(edge);
  }
  for (std::size_t plane = 0; plane < num_planes; ++plane) begin_[plane + 1] += begin_[plane];
}

}  // namespace earshot
