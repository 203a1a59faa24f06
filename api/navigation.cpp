// SPDX-License-Identifier: Apache-2.0
#include "earshot/navigation.h"

#include <algorithm>

#include "api/convert.h"
#include "api/scene_model.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/nav/geodesic_field.h"
#include "sim/nav/motion.h"
#include "sim/nav/navmesh.h"

namespace earshot::api {
namespace {

/// A path with more corners is not found by any search of ours; the bound keeps a fault from looping.
constexpr int kMaxPathCorners = 10'000;

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

struct Navigation::Model {
  std::shared_ptr<Scene::Model> scene;
  Navmesh navmesh;

  [[nodiscard]] glm::vec3 local(const Vec3& point) const {
    require_finite(point, "point");
    return scene->scene().to_local(glm_of(point));
  }
  [[nodiscard]] Vec3 world(glm::vec3 point) const { return vec3_of(scene->scene().to_world(point)); }
};

Navigation::Navigation(const Scene& scene, const NavigationOptions& options)
    : model_(std::make_shared<const Model>(Model{scene.model(), Navmesh(scene.model()->scene().mesh(), navmesh_config(options))})) {}

double Navigation::area_m2() const { return static_cast<double>(model_->navmesh.main_area_m2()); }
int Navigation::num_islands() const { return model_->navmesh.num_islands(); }

std::optional<Vec3> Navigation::snap(const Vec3& point, double reach_m) const {
  const auto found = model_->navmesh.snap(model_->local(point), static_cast<float>(reach_m));
  if (!found) return std::nullopt;
  return model_->world(*found);
}

Vec3 Navigation::random_point(std::uint64_t seed, std::uint32_t index) const {
  return model_->world(model_->navmesh.random_point(RandomStream(seed, Purpose::episode, index), 0));
}

std::optional<double> Navigation::distance_m(const Vec3& from, const Vec3& to) const {
  const auto length = model_->navmesh.path_length_m(model_->local(from), model_->local(to));
  if (!length) return std::nullopt;
  return static_cast<double>(*length);
}

std::vector<Vec3> Navigation::path(const Vec3& from, const Vec3& to) const {
  if (!distance_m(from, to)) return {};
  const GeodesicField field(model_->navmesh, model_->local(to));
  std::vector<Vec3> corners{from};
  glm::vec3 place = model_->local(from);
  while (static_cast<int>(corners.size()) < kMaxPathCorners) {
    const auto next = field.next_corner(place);
    if (!next) return {};
    corners.push_back(model_->world(*next));
    if (*next == field.goal() || *next == place) break;
    place = *next;
  }
  return corners;
}

MoveResult Navigation::move(const Vec3& from, const Vec3& displacement) const {
  require_finite(displacement, "displacement");
  const auto start = model_->navmesh.snap(model_->local(from));
  if (!start) throw InputError("from", "is not on the walkable surface", "take a point that snap() finds");
  const glm::vec3 offset{static_cast<float>(displacement.x), 0.f, static_cast<float>(displacement.z)};
  const earshot::MoveResult moved = slide(model_->navmesh, *start, offset);
  return {model_->world(moved.position), moved.collided};
}

}  // namespace earshot::api
