// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/polygon.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <numeric>

#include "sim/base/errors.h"

namespace earshot {
namespace {

double cross(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

/// The polygon seen along its normal (Newell's), along the axis nearest to it, counter-clockwise.
std::vector<glm::dvec2> flatten(std::span<const glm::vec3> corners) {
  glm::dvec3 normal(0);
  for (std::size_t i = 0; i < corners.size(); ++i)
    normal += glm::cross(glm::dvec3(corners[i]), glm::dvec3(corners[(i + 1) % corners.size()]));
  int axis = 0;
  for (int other : {1, 2}) {
    if (std::fabs(normal[other]) > std::fabs(normal[axis])) axis = other;
  }
  std::vector<glm::dvec2> flat;
  flat.reserve(corners.size());
  for (const glm::vec3 corner : corners) {
    const double u = corner[(axis + 1) % 3], v = corner[(axis + 2) % 3];
    flat.emplace_back(normal[axis] < 0 ? glm::dvec2(v, u) : glm::dvec2(u, v));
  }
  return flat;
}

}  // namespace

void triangulate_polygon(std::span<const glm::vec3> corners, std::vector<std::uint32_t>& indices) {
  if (corners.size() < 3) return;
  if (corners.size() == 3) {
    indices.insert(indices.end(), {0, 1, 2});
    return;
  }
  EARSHOT_EXPECT(corners.size() <= largest_polygon);
  const std::vector<glm::dvec2> flat = flatten(corners);
  std::vector<std::uint32_t> left(corners.size());
  std::iota(left.begin(), left.end(), 0u);
  const auto is_ear = [&](std::size_t at) {
    const std::size_t n = left.size();
    const std::uint32_t previous = left[(at + n - 1) % n], ear = left[at], next = left[(at + 1) % n];
    if (!(cross(flat[previous], flat[ear], flat[next]) > 0)) return false;  // a reflex or straight corner
    for (const std::uint32_t other : left) {
      if (other == previous || other == ear || other == next) continue;
      const glm::dvec2 p = flat[other];
      if (p == flat[previous] || p == flat[ear] || p == flat[next]) continue;  // a seam that joins a hole
      if (cross(flat[previous], flat[ear], p) >= 0 && cross(flat[ear], flat[next], p) >= 0 && cross(flat[next], flat[previous], p) >= 0)
        return false;
    }
    return true;
  };
  while (left.size() > 3) {
    std::size_t ear = 1;  // without any ear (self-crossing, or all on a line): a fan
    for (std::size_t at = 1; at <= left.size(); ++at) {
      if (!is_ear(at % left.size())) continue;
      ear = at % left.size();
      break;
    }
    const std::size_t n = left.size();
    indices.insert(indices.end(), {left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  indices.insert(indices.end(), {left[0], left[1], left[2]});
}

}  // namespace earshot
