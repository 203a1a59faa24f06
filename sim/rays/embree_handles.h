// SPDX-License-Identifier: Apache-2.0
#pragma once

// Owners of Embree's handles, for sim/rays alone: public headers show no type of Embree.

#if EARSHOT_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <memory>
#include <type_traits>

namespace earshot {

struct ReleaseEmbree {
  void operator()(RTCDevice device) const noexcept { rtcReleaseDevice(device); }
  void operator()(RTCGeometry geometry) const noexcept { rtcReleaseGeometry(geometry); }
  void operator()(RTCScene scene) const noexcept { rtcReleaseScene(scene); }
};
using EmbreeDevice = std::unique_ptr<std::remove_pointer_t<RTCDevice>, ReleaseEmbree>;
using EmbreeGeometry = std::unique_ptr<std::remove_pointer_t<RTCGeometry>, ReleaseEmbree>;
using EmbreeSceneHandle = std::unique_ptr<std::remove_pointer_t<RTCScene>, ReleaseEmbree>;

}  // namespace earshot
