// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <glm/vec3.hpp>

#include "earshot/vec3.h"
#include "sim/base/errors.h"

/// Positions of the public headers and of the engine.
namespace earshot::api {

inline glm::dvec3 glm_of(const Vec3& v) { return {v.x, v.y, v.z}; }
inline Vec3 vec3_of(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

/// @throws InputError naming `key` if a coordinate is not finite.
inline void require_finite(const Vec3& position, const char* key) {
  for (const double value : {position.x, position.y, position.z}) require(std::isfinite(value), key, value, "must be finite");
}

}  // namespace earshot::api
