// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/place_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "sim/acoustics/core/sampling.h"
#include "sim/base/errors.h"
#include "sim/scene/scene_report.h"

namespace earshot {
namespace {

/// A scene that is thinner than this is a thing in the open, no room.
constexpr float kThinnestRoomM = 1.5f;
constexpr double kMaxLeaked = 0.01;
/// People place sources and listeners at least so far from walls.
constexpr float kFromWallsM = 0.2f;

bool is_within(const Bounds& bounds, glm::vec3 place) {
  return glm::all(glm::greaterThanEqual(place, bounds.lower)) && glm::all(glm::lessThanEqual(place, bounds.upper));
}

/// Whether what a place sees all round is thinner than a room: the inside of a cabinet or a pipe.
bool sees_a_thing(const Scene& scene, glm::vec3 place) {
  constexpr std::uint32_t kRays = 64;
  const SphereSequence directions(0x80000000u, 0x80000000u);
  Bounds seen{place, place};
  for (std::uint32_t i = 0; i < kRays; ++i) {
    const Hit hit = scene.rays().intersect(place, directions.direction(i));
    if (!hit.valid()) continue;
    seen.lower = glm::min(seen.lower, hit.position);
    seen.upper = glm::max(seen.upper, hit.position);
  }
  const glm::vec3 size = seen.upper - seen.lower;
  return std::min({size.x, size.y, size.z}) < kThinnestRoomM;
}

std::string shown(glm::dvec3 p) { return fmt::format("{:.6g},{:.6g},{:.6g}", p.x, p.y, p.z); }

/// How a place may have been meant that lies outside the bounds: in another unit, or with z up.
std::string suggestion(const Scene& scene, glm::dvec3 world) {
  struct Reading {
    const char* unit_name;
    double factor;
    bool is_z_up;
  };
  constexpr std::array<Reading, 6> readings{{{"with z up", 1, true},
                                             {"in centimetres", 0.01, false},
                                             {"in millimetres", 0.001, false},
                                             {"in feet", 0.3048, false},
                                             {"in inches", 0.0254, false},
                                             {"in centimetres with z up", 0.01, true}}};
  if (is_within(scene.bounds(), scene.to_local(world))) return {};
  const Bounds middle{scene.bounds().lower + kFromWallsM, scene.bounds().upper - kFromWallsM};
  for (const auto& [unit_name, factor, is_z_up] : readings) {
    const glm::dvec3 meant = factor * (is_z_up ? glm::dvec3(world.x, world.z, -world.y) : world);
    if (is_within(middle, scene.to_local(meant)))
      return fmt::format(" (if it was meant {}, it is {}, inside the scene)", unit_name, shown(meant));
  }
  return {};
}

}  // namespace

std::vector<std::string> PlaceCheck::check(const NamedPlace& source, const NamedPlace& listener) const {
  const Scene& scene = acoustics_.scene();
  if (!is_within(scene.bounds(), source.position) && !is_within(scene.bounds(), listener.position)) {
    if (!is_closed_room()) return {};
    return {fmt::format("{} and {} both lie outside the closed scene: only sound that travels around it is heard", text_of(source),
                        text_of(listener))};
  }
  const AirBetween between = air(source.position, listener.position);
  if (between != AirBetween::first_outside && between != AirBetween::second_outside) return {};
  const NamedPlace &outside = between == AirBetween::first_outside ? source : listener, &enclosed = &outside == &source ? listener : source;
  if (acoustics_.plan().straight_transmission || traces_transmission(acoustics_))
    return {fmt::format("{} lies outside the closed surfaces around {}: only sound through walls is heard", text_of(outside),
                        text_of(enclosed))};
  if (positions().inside_solid(enclosed.position)) return {};
  if (!positions().has_consistent_windings() && sees_a_thing(scene, enclosed.position))
    return {fmt::format("no air joins {} and {}: one of them lies in a closed object", text_of(outside), text_of(enclosed))};
  refuse(outside, enclosed);
}

std::optional<std::string> PlaceCheck::inside_solid(const NamedPlace& place) const {
  if (!positions().inside_solid(place.position)) return std::nullopt;
  return fmt::format("the {} lies inside a wall or an object", text_of(place));
}

AirBetween PlaceCheck::air(glm::vec3 source, glm::vec3 listener) const {
  const EmbreeScene& rays = acoustics_.scene().rays();
  const auto in_sight = [&](glm::vec3 a, glm::vec3 b) { return a == b || !rays.occluded(a, b); };
  {
    const std::lock_guard lock(mutex_);
    if (before_ && in_sight(before_->source, source) && in_sight(before_->listener, listener)) {
      before_->source = source;
      before_->listener = listener;
      return before_->air;
    }
  }
  const AirBetween found = air_between(acoustics_.scene(), source, listener);
  const std::lock_guard lock(mutex_);
  before_ = {source, listener, found};
  return found;
}

const PositionCheck& PlaceCheck::positions() const {
  const std::lock_guard lock(mutex_);
  if (!positions_) positions_ = std::make_unique<const PositionCheck>(acoustics_.scene());
  return *positions_;
}

std::string PlaceCheck::text_of(const NamedPlace& place) const {
  return fmt::format("{} {}", place.name, shown(acoustics_.scene().to_world(place.position)));
}

bool PlaceCheck::is_closed_room() const {
  const std::lock_guard lock(mutex_);
  if (!is_closed_room_) {
    const Scene& scene = acoustics_.scene();
    const glm::vec3 size = scene.bounds().upper - scene.bounds().lower;
    is_closed_room_ = std::min({size.x, size.y, size.z}) >= kThinnestRoomM && report_scene(scene).leaked_ray_fraction <= kMaxLeaked;
  }
  return *is_closed_room_;
}

void PlaceCheck::refuse(const NamedPlace& outside, const NamedPlace& enclosed) const {
  const Scene& scene = acoustics_.scene();
  const glm::dvec3 world = scene.to_world(outside.position);
  throw InputError(fmt::format("{}: {}", scene.name(), text_of(outside)),
                   fmt::format("lies outside the scene, whose closed surfaces contain {}: no sound passes between them{}",
                               text_of(enclosed), suggestion(scene, world)),
                   fmt::format("give a position in metres with y up; the scene spans {} to {}{}",
                               shown(scene.to_world(scene.bounds().lower)), shown(scene.to_world(scene.bounds().upper)),
                               scene.import_report().axes ? "; or correct the unit or the up axis of the mesh" : ""));
}

}  // namespace earshot
