// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <span>

#include "sim/scene/scene.h"
#include "sim/vision/camera.h"

namespace earshot {

/// Rays per second of one thread through Embree alone (bare_rays.h).
struct BareRayRates {
  double camera = 0;   ///< primary rays of this camera, sixteen at a time in blocks of 4 x 4 pixels, from every pose in turn
  double diffuse = 0;  ///< nearest hits of paths that leave every surface diffusely, one ray at a time
};

/// Question: how much do rays alone cost?  Median of five blocks; the camera and the paths stand where `poses` are, foot points.
BareRayRates measure_bare_rays(const Scene& scene, const CameraConfig& camera, std::span<const glm::vec3> poses, double seconds);

}  // namespace earshot
