// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "earshot/navigation.h"
#include "sim/nav/geodesic_field.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/scene.h"

namespace earshot::api {

/// The floor of a scene in the coordinates of its file.  Safe from any thread.
struct Navigation::Model {
  Model(std::shared_ptr<const earshot::Scene> its_scene, std::shared_ptr<const Navmesh> its_navmesh)
      : scene(std::move(its_scene)), navmesh(std::move(its_navmesh)) {}

  std::shared_ptr<const earshot::Scene> scene;
  std::shared_ptr<const Navmesh> navmesh;

  /// @throws InputError for a point that is not finite.
  [[nodiscard]] glm::vec3 local(const Vec3& point) const;
  [[nodiscard]] Vec3 world(glm::vec3 point) const;
  /// Distances to a place; null where it is off the floor.  The 32 that were asked for last are kept.
  [[nodiscard]] std::shared_ptr<const GeodesicField> field_to(glm::vec3 goal) const;

  mutable std::mutex mutex;  ///< guards the fields
  mutable std::vector<std::pair<glm::vec3, std::shared_ptr<const GeodesicField>>> fields;
};

/// The floor of a scene that has been loaded.
Navigation navigation_of(std::shared_ptr<const earshot::Scene> scene, std::shared_ptr<const Navmesh> navmesh);

}  // namespace earshot::api
