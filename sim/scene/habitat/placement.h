// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <set>
#include <string>

#include "sim/scene/habitat/dataset_config.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Where an asset stands: world = translation + rotation (scale frame p - center) for its point p.
struct Placement {
  glm::dmat3 frame{1};  ///< from the axes of the asset to y up and -z in front
  glm::dvec3 scale{1};
  glm::dquat rotation{1, 0, 0, 0};
  glm::dvec3 translation{0};
  glm::dvec3 center{0};             ///< of mass, of the asset after frame and scale
  bool is_centered_on_box = false;  ///< center is the middle of the bounding box there
};

/// Of a template alone: up, front, scale and units_to_meters.  Throws InputError: only one of up and front, not orthogonal, zero scale, an
/// origin other than zero, which has no public description.
Placement frame_of(const Attributes& attributes);

/// With an instance added: translation, rotation, uniform_scale, non_uniform_scale.  Throws InputError: out of range, a scale that differs
/// by axis together with up and front other than Habitat's own, of which the order has no public description.
Placement place(Placement frame, const JsonFields& instance);

/// With the centre of mass as the point that the translation places, unless the instance or the scene says `asset_local`.
/// Throws InputError: an unknown translation_origin, a COM other than zero of a scaled or turned asset.
Placement place_by_mass(Placement placed, const Attributes& attributes, const JsonFields& instance, const JsonFields& scene);

/// From the coordinates of the asset to those of the scene.  mesh: of the asset, for its bounding box.
glm::dmat4 matrix_of(const Placement& placement, const TriangleMesh& mesh);

}  // namespace earshot
