// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/loudspeaker_layout.h"

#include <algorithm>
#include <cstdint>
#include <numbers>
#include <utility>

#include "sim/audio/head/listener_orientation.h"

namespace earshot {
namespace {

/// Loudspeakers of a channel mask (WAVEFORMATEXTENSIBLE, dwChannelMask).  Channels of a file come in the order of these bits.
enum Speaker : std::uint32_t {
  front_left = 0x1,
  front_right = 0x2,
  front_centre = 0x4,
  low_frequency = 0x8,
  back_left = 0x10,
  back_right = 0x20,
  side_left = 0x200,
  side_right = 0x400
};

constexpr float kCardioid = 0.5f, kDipole = 0.f, kOmni = 1.f;
constexpr float kSpacedPairM = 0.5f, kOrtfM = 0.17f;

Microphone microphone(const char* name, double azimuth_deg, float omni_weight = kCardioid, float to_the_right_m = 0.f) {
  return {.position_m = {to_the_right_m, 0, 0},
          .directivity = Directivity::first_order(omni_weight),
          .orientation = glm::quat(ListenerOrientation(azimuth_deg * std::numbers::pi / 180).local_to_world()),
          .name = name};
}

Microphone lfe() {
  Microphone channel;
  channel.lowpass_hz = kLfeCutoffHz;
  channel.name = "lfe";
  return channel;
}

template <class... Channels>
ListenerLayout layout_of(std::uint32_t mask, Channels... channels) {
  ListenerLayout layout = ListenerLayout::array({std::move(channels)...});
  layout.channel_mask = mask;
  return layout;
}

ListenerLayout stereo_pair(double azimuth_deg, float omni_weight, float apart_m) {
  return layout_of(0, microphone("left", azimuth_deg, omni_weight, -0.5f * apart_m),
                   microphone("right", -azimuth_deg, omni_weight, 0.5f * apart_m));
}

ListenerLayout quad() {
  return layout_of(front_left | front_right | back_left | back_right, microphone("left", 30), microphone("right", -30),
                   microphone("rear_left", 95), microphone("rear_right", -95));
}

ListenerLayout surround_5_1() {
  return layout_of(front_left | front_right | front_centre | low_frequency | side_left | side_right, microphone("left", 30),
                   microphone("right", -30), microphone("centre", 0), lfe(), microphone("surround_left", 110),
                   microphone("surround_right", -110));
}

ListenerLayout surround_7_1() {
  return layout_of(front_left | front_right | front_centre | low_frequency | back_left | back_right | side_left | side_right,
                   microphone("left", 30), microphone("right", -30), microphone("centre", 0), lfe(), microphone("rear_left", 135),
                   microphone("rear_right", -135), microphone("side_left", 90), microphone("side_right", -90));
}

}  // namespace

std::optional<ListenerLayout> loudspeaker_layout(std::string_view name) {
  if (name == "stereo" || name == "stereo:xy") return stereo_pair(45, kCardioid, 0);
  if (name == "stereo:ms") return layout_of(0, microphone("mid", 0), microphone("side", 90, kDipole));
  if (name == "stereo:ab") return stereo_pair(0, kOmni, kSpacedPairM);
  if (name == "stereo:ortf") return stereo_pair(55, kCardioid, kOrtfM);
  if (name == "quad") return quad();
  if (name == "surround_5_1") return surround_5_1();
  if (name == "surround_7_1") return surround_7_1();
  return std::nullopt;
}

std::uint32_t channel_mask_of(std::span<const std::string> names) {
  for (const char* name : {"quad", "surround_5_1", "surround_7_1"})
    if (const ListenerLayout layout = *loudspeaker_layout(name); std::ranges::equal(layout.channel_names(), names))
      return layout.channel_mask;
  return 0;
}

}  // namespace earshot
