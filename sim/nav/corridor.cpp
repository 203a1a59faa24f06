// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/corridor.h"

#include <cmath>
#include <vector>

#include "sim/nav/navmesh_impl.h"

namespace earshot {

std::optional<double> corridor_length_m(const Navmesh::Impl& nav, const Located& from, const Located& to) {
  constexpr int search_nodes = 65535, max_path = 4096;  // Detour's largest pool: a search does not give up halfway
  std::vector<dtPolyRef> corridor(max_path);
  std::vector<float> points(3 * max_path);
  int num_polygons = 0, num_points = 0;
  const OwnedNavMeshQuery query = make_query(*nav.navmesh, search_nodes);
  const dtPolyRef first = nav.ref_of(from.polygon), last = nav.ref_of(to.polygon);
  query->findPath(first, last, &from.point.x, &to.point.x, &nav.any_island, corridor.data(), &num_polygons, max_path);
  if (num_polygons == 0 || corridor[static_cast<std::size_t>(num_polygons) - 1] != last) return std::nullopt;
  query->findStraightPath(&from.point.x, &to.point.x, corridor.data(), num_polygons, points.data(), nullptr, nullptr, &num_points,
                          max_path);
  double length_m = 0;
  for (int i = 1; i < num_points; ++i) {
    const float *a = &points[3 * (i - 1)], *b = &points[3 * i];
    length_m += std::hypot(static_cast<double>(b[0]) - a[0], static_cast<double>(b[1]) - a[1], static_cast<double>(b[2]) - a[2]);
  }
  return length_m;
}

std::optional<double> corridor_length_m(const Navmesh& navmesh, glm::vec3 from, glm::vec3 to) {
  const Navmesh::Impl& nav = navmesh.impl();
  const auto first = nav.locate(from, 0.5f), last = nav.locate(to, 0.5f);
  if (!first || !last) return std::nullopt;
  return corridor_length_m(nav, *first, *last);
}

}  // namespace earshot
