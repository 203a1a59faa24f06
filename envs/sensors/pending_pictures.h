// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/vision/camera.h"
#include "sim/vision/depth_noise.h"

namespace earshot {

/// Pictures to render for the cameras of one agent: a pose in a scene, and the depth noise there.  Pictures that are drawn with those of
/// other agents outlive the task that asked for them, and the episode: scene and looks are held until then.
struct PendingPictures {
  bool wanted = false;
  std::shared_ptr<const Scene> scene = {};
  std::shared_ptr<const Appearance> appearance = {};
  Pose pose = {};
  std::uint64_t episode_index = 0;
  DepthNoiseDraw noise = {};
};

}  // namespace earshot
