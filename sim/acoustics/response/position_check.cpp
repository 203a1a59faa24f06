// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/position_check.h"

#include <algorithm>
#include <cstdint>
#include <glm/geometric.hpp>

#include "sim/acoustics/core/sampling.h"
#include "sim/scene/air_sample.h"

namespace earshot {
namespace {

constexpr std::uint32_t kRays = 5;
constexpr int kMajority = 4;
constexpr std::size_t kAirPoints = 100;
/// Fraction of the air's rays that must agree before windings count as consistent.
constexpr double kConsistent = 0.8;

}  // namespace

PositionCheck::PositionCheck(const Scene& scene) : scene_(&scene) {
  const std::vector<glm::vec3> points = sample_air(scene, 0).points;
  int front = 0, back = 0;
  const std::size_t count = std::min(points.size(), kAirPoints);
  for (std::size_t i = 0; i < count; ++i) {
    const FaceCounts faces = count_faces(points[i * points.size() / count]);
    front += faces.front;
    back += faces.back;
  }
  air_meets_front_ = front > kConsistent * (front + back);
  air_meets_back_ = back > kConsistent * (front + back);
}

PositionCheck::FaceCounts PositionCheck::count_faces(glm::vec3 point) const {
  const TriangleMesh& mesh = scene_->mesh();
  const SphereSequence directions(0x2C1B3C6Du, 0x297A2D39u);  // any that lie along no wall
  FaceCounts faces;
  for (std::uint32_t i = 0; i < kRays; ++i) {
    const glm::vec3 direction = directions.direction(i);
    const Hit hit = scene_->rays().intersect(point, direction);
    if (!hit.valid()) continue;
    const glm::uvec3 corner = mesh.triangles[hit.triangle];
    const glm::dvec3 a = mesh.vertices[corner.x], b = mesh.vertices[corner.y], c = mesh.vertices[corner.z];
    ++(glm::dot(glm::cross(b - a, c - a), glm::dvec3(direction)) < 0 ? faces.front : faces.back);
  }
  return faces;
}

bool PositionCheck::inside_solid(glm::vec3 point) const {
  if (!has_consistent_windings()) return false;
  const FaceCounts faces = count_faces(point);
  return (air_meets_front_ ? faces.back : faces.front) >= kMajority;
}

}  // namespace earshot
