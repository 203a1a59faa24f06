// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/wall_crossing.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <span>

#include "sim/acoustics/geometry/mesh_sides.h"

namespace earshot {
namespace {

constexpr float kParallel = 0.98f;   // cosine of 11 degrees
constexpr float kMinCosine = 1e-3f;  // a grazing ray stays inside for at most 1000 thicknesses

bool same_material(const AcousticSurfaces& surfaces, std::uint32_t a, std::uint32_t b) {
  if (a == b) return true;
  const auto materials = std::span(surfaces.scene().materials());
  return materials[a].name == materials[b].name && std::ranges::equal(surfaces.transmission(a), surfaces.transmission(b)) &&
         std::ranges::equal(surfaces.damping_db_per_m(a), surfaces.damping_db_per_m(b)) &&
         materials[a].speed_m_per_s == materials[b].speed_m_per_s;
}

/// The far face of the wall whose near face is `hit`, if the next face along the ray can be one.
Hit find_far_face(const AcousticSurfaces& surfaces, glm::vec3 start, glm::vec3 direction, const Hit& hit, float reach_m) {
  const bool enters = meets_front(surfaces.scene().mesh(), hit.triangle, direction);
  const float cosine = std::max(std::fabs(glm::dot(direction, hit.normal)), kMinCosine), wall_m = kMaxWallThicknessM / cosine;
  const bool may_be_solid = enters && surfaces.bounds_solid(hit.triangle);
  const Hit far = surfaces.scene().rays().intersect(start, direction, may_be_solid ? std::max(wall_m, reach_m) : wall_m);
  if (!far.valid() || enters == meets_front(surfaces.scene().mesh(), far.triangle, direction)) return {};
  const bool solid = may_be_solid && surfaces.bounds_solid(far.triangle);
  if (!solid && far.distance_m > wall_m) return {};
  // Corners and ends of walls: in at the front, out at the side.  Only outward windings tell that the way between is inside.
  const bool parallel = std::fabs(glm::dot(far.normal, hit.normal)) >= kParallel;
  if (!solid && !parallel && (!enters || far.distance_m > kMaxWallThicknessM)) return {};
  const auto& material = surfaces.scene().mesh().triangle_material;
  if (!same_material(surfaces, material[hit.triangle], material[far.triangle])) return {};
  return far;
}

glm::vec3 past(const Hit& hit) { return offset_from_surface(hit.position, -hit.normal); }

}  // namespace

WallCrossing cross_wall(const AcousticSurfaces& surfaces, glm::vec3 direction, const Hit& hit, float reach_m) {
  WallCrossing crossing{.exit = past(hit), .material = surfaces.scene().mesh().triangle_material[hit.triangle]};
  const Hit far = find_far_face(surfaces, crossing.exit, direction, hit, reach_m);
  if (!far.valid()) return crossing;
  const glm::vec3 exit = past(far);
  // Windings that point inward are either a wall turned inside out or the gap in front of a wall that begins here.
  if (!meets_front(surfaces.scene().mesh(), hit.triangle, direction) && find_far_face(surfaces, exit, direction, far, 0.f).valid())
    return crossing;
  crossing.exit = exit;
  crossing.inside_m = glm::length(far.position - hit.position);
  crossing.thick = true;
  return crossing;
}

void transmit(const AcousticSurfaces& surfaces, const WallCrossing& crossing, std::span<float> energy) {
  const auto tau = surfaces.transmission(crossing.material);
  for (std::size_t band = 0; band < tau.size(); ++band) energy[band] *= tau[band];
  if (!(crossing.inside_m > 0)) return;
  const auto damping = surfaces.damping_db_per_m(crossing.material);
  for (std::size_t band = 0; band < damping.size(); ++band) {
    if (damping[band] > 0) energy[band] *= std::pow(10.f, -0.1f * damping[band] * crossing.inside_m);
  }
}

float extra_path_m(const AcousticSurfaces& surfaces, const WallCrossing& crossing) {
  const float speed = surfaces.scene().materials()[crossing.material].speed_m_per_s;
  return speed > 0 ? crossing.inside_m * (surfaces.speed_of_sound_m_per_s() / speed - 1.f) : 0.f;
}

}  // namespace earshot
