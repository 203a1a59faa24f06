// SPDX-License-Identifier: Apache-2.0
#include "earshot/navigation.h"

#include <algorithm>
#include <utility>

#include "api/convert.h"
#include "api/navigation_model.h"
#include "api/scene_model.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/nav/motion.h"

namespace earshot::api {
namespace {

/// A path with more corners is not found by any search of ours; the bound keeps a fault from looping.
constexpr int kMaxPathCorners = 10'000;
/// A place this far from the floor is no goal.
constexpr float kGoalReachM = 1.f;
/// Distances to these many places are kept: those to the goals of an episode.
constexpr std::size_t kMaxFields = 32;

NavmeshConfig navmesh_config(const NavigationOptions& options) {
  NavmeshConfig config;
  config.agent_radius_m = static_cast<float>(options.agent_radius_m);
  config.agent_height_m = static_cast<float>(options.agent_height_m);
  config.max_climb_m = static_cast<float>(options.max_climb_m);
  config.max_slope_deg = static_cast<float>(options.max_slope_deg);
  validate(config);
  return config;
}

}  // namespace

glm::vec3 Navigation::Model::local(const Vec3& point) const {
  require_finite(point, "point");
  return scene->to_local(glm_of(point));
}
Vec3 Navigation::Model::world(glm::vec3 point) const { return vec3_of(scene->to_world(point)); }

std::shared_ptr<const GeodesicField> Navigation::Model::field_to(glm::vec3 goal) const {
  const auto find_kept = [&] { return std::ranges::find_if(fields, [&](const auto& one) { return one.first == goal; }); };
  {
    const std::lock_guard lock(mutex);
    if (const auto known = find_kept(); known != fields.end()) {
      std::rotate(known, known + 1, fields.end());  // the first one goes first
      return fields.back().second;
    }
  }
  auto field = navmesh->snap(goal, kGoalReachM) ? std::make_shared<const GeodesicField>(*navmesh, goal, kGoalReachM) : nullptr;
  const std::lock_guard lock(mutex);
  if (find_kept() != fields.end()) return field;  // another thread was faster
  if (fields.size() >= kMaxFields) fields.erase(fields.begin());
  fields.emplace_back(goal, field);
  return field;
}

Navigation navigation_of(std::shared_ptr<const earshot::Scene> scene, std::shared_ptr<const Navmesh> navmesh) {
  return Navigation(std::make_shared<const Navigation::Model>(std::move(scene), std::move(navmesh)));
}

Navigation::Navigation(const Scene& scene, const NavigationOptions& options)
    : model_(std::make_shared<const Model>(std::shared_ptr<const earshot::Scene>(scene.model(), &scene.model()->scene()),
                                           std::make_shared<const Navmesh>(scene.model()->scene().mesh(), navmesh_config(options)))) {}

double Navigation::area_m2() const { return static_cast<double>(model_->navmesh->main_area_m2()); }
int Navigation::num_islands() const { return model_->navmesh->num_islands(); }

std::optional<Vec3> Navigation::snap(const Vec3& point, double reach_m) const {
  const auto found = model_->navmesh->snap(model_->local(point), static_cast<float>(reach_m));
  if (!found) return std::nullopt;
  return model_->world(*found);
}

Vec3 Navigation::random_point(std::uint64_t seed, std::uint32_t index) const {
  return model_->world(model_->navmesh->random_point(RandomStream(seed, Purpose::episode, index), 0));
}

std::optional<double> Navigation::distance_m(const Vec3& from, const Vec3& to) const {
  const auto field = model_->field_to(model_->local(to));
  const auto length = field ? field->distance_m(model_->local(from)) : std::nullopt;
  if (!length) return std::nullopt;
  return static_cast<double>(*length);
}

std::vector<Vec3> Navigation::path(const Vec3& from, const Vec3& to) const {
  const auto field = model_->field_to(model_->local(to));
  glm::vec3 place = model_->local(from);
  if (!field || !field->distance_m(place)) return {};
  std::vector<Vec3> corners{from};
  while (static_cast<int>(corners.size()) < kMaxPathCorners) {
    const auto next = field->next_corner(place);
    if (!next) return {};
    corners.push_back(model_->world(*next));
    if (*next == field->goal() || *next == place) break;
    place = *next;
  }
  return corners;
}

MoveResult Navigation::move(const Vec3& from, const Vec3& displacement) const {
  require_finite(displacement, "displacement");
  const auto start = model_->navmesh->snap(model_->local(from));
  if (!start) throw InputError("from", "is not on the walkable surface", "take a point that snap() finds");
  const glm::vec3 offset{static_cast<float>(displacement.x), 0.f, static_cast<float>(displacement.z)};
  const earshot::MoveResult moved = slide(*model_->navmesh, *start, offset);
  return {model_->world(moved.position), moved.collided};
}

}  // namespace earshot::api
