// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/wall_parts.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace earshot {
namespace {

/// Of the edge of a part: a triangle nearer to its faces than this touches it without reaching into it.
constexpr float kPartSlack = 1e-3f;

/// A triangle, for overlaps with boxes.
class TrianglePlanes {
 public:
  explicit TrianglePlanes(const std::array<glm::vec3, 3>& corners) : corner_(corners) {
    for (std::size_t i = 0; i < 3; ++i) edge_[i] = corners[(i + 1) % 3] - corners[i];
    normal_ = glm::cross(edge_[0], edge_[1]);
  }
  /// Does it share a point with the box about `centre`?
  [[nodiscard]] bool overlaps(glm::vec3 centre, glm::vec3 half_m) const {
    if (std::abs(glm::dot(normal_, centre - corner_[0])) > glm::dot(glm::abs(normal_), half_m)) return false;
    for (int axis = 0; axis < 3; ++axis) {
      glm::vec3 unit(0);
      unit[axis] = 1;
      if (is_apart_along(unit, centre, half_m)) return false;
      for (const glm::vec3& edge : edge_)
        if (is_apart_along(glm::cross(unit, edge), centre, half_m)) return false;
    }
    return true;
  }

 private:
  [[nodiscard]] bool is_apart_along(glm::vec3 axis, glm::vec3 centre, glm::vec3 half_m) const {
    const float a = glm::dot(axis, corner_[0] - centre), b = glm::dot(axis, corner_[1] - centre), c = glm::dot(axis, corner_[2] - centre);
    const float reach = glm::dot(glm::abs(axis), half_m);
    return std::min(a, std::min(b, c)) > reach || std::max(a, std::max(b, c)) < -reach;
  }
  std::array<glm::vec3, 3> corner_, edge_;
  glm::vec3 normal_;
};

}  // namespace

WallParts::WallParts(const TriangleMesh& mesh, const FieldBoxes& boxes) : of_box_(boxes.size(), kNone) {
  for (const glm::uvec3 corner : mesh.triangles) mark({mesh.vertices[corner.x], mesh.vertices[corner.y], mesh.vertices[corner.z]}, boxes);
}

void WallParts::mark(const std::array<glm::vec3, 3>& corners, const FieldBoxes& boxes) {
  const glm::vec3 box_m = boxes.edge_m(), part_m = box_m / static_cast<float>(FieldBoxes::kPointsPerEdge), slack_m = kPartSlack * part_m;
  const glm::vec3 lower = glm::min(corners[0], glm::min(corners[1], corners[2])) - slack_m;
  const glm::vec3 upper = glm::max(corners[0], glm::max(corners[1], corners[2])) + slack_m;
  const TrianglePlanes triangle(corners);
  for_each_place(boxes.index_at(lower), boxes.index_at(upper), [&](const glm::ivec3& index) {
    const glm::vec3 corner = boxes.origin() + glm::vec3(index) * box_m;
    const glm::vec3 middle = corner + 0.5f * box_m;
    if (!triangle.overlaps(middle, 0.5f * box_m + slack_m)) return;
    const bool reaches_into_box = triangle.overlaps(middle, 0.5f * box_m - slack_m);
    std::uint32_t& of_box = of_box_[boxes.number_of(index)];
    const auto part_at = [&](glm::vec3 point) {
      return glm::clamp(glm::ivec3(glm::floor((point - corner) / part_m)), glm::ivec3(0), glm::ivec3(FieldBoxes::kPointsPerEdge - 1));
    };
    for_each_place(part_at(lower), part_at(upper), [&](const glm::ivec3& part) {
      const glm::vec3 centre = corner + (glm::vec3(part) + 0.5f) * part_m;
      if (!triangle.overlaps(centre, 0.5f * part_m + slack_m)) return;
      if (of_box == kNone) {
        of_box = static_cast<std::uint32_t>(parts_.size());
        parts_.push_back({});
      }
      const int number = FieldBoxes::lattice_number(part);
      parts_[of_box].touch.set(number);
      parts_[of_box].reaches_into_box = parts_[of_box].reaches_into_box || reaches_into_box;
      if (triangle.overlaps(centre, 0.5f * part_m - slack_m)) parts_[of_box].reach.set(number);
    });
  });
}

}  // namespace earshot
