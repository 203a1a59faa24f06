// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim/audio/head/listener_layout.h"

namespace earshot {

/// Microphones for a set of loudspeakers: a channel each, in the order of WAV files.  All are at the listener's position and are cardioids
/// whose front faces their loudspeaker, unless stated.  Angles are to the left of the listener's front, in degrees.
///  - stereo, stereo:xy     left 45, right -45
///  - stereo:ms             mid 0; side, a dipole, 90.  Left is mid + side, right is mid - side
///  - stereo:ab             left, right: omnidirectional, 0.5 m apart
///  - stereo:ortf           left 55, right -55, 0.17 m apart
///  - quad                  left 30, right -30, rear_left 95, rear_right -95
///  - surround_5_1          left 30, right -30, centre 0, lfe, surround_left 110, surround_right -110
///  - surround_7_1          left 30, right -30, centre 0, lfe, rear_left 135, rear_right -135, side_left 90, side_right -90
/// lfe, the low-frequency channel: omnidirectional, through a LowPass at kLfeCutoffHz, at the level of the others.  Angles of quad and
/// surround: those that the documentation of SoundSpaces 2.0 names.
/// Nullopt for any other name.
std::optional<ListenerLayout> loudspeaker_layout(std::string_view name);

/// ListenerLayout::channel_mask of the layout above that has channels of these names; 0 if none has.
std::uint32_t channel_mask_of(std::span<const std::string> names);

/// Upper end of a low-frequency channel (ITU-R BS.775-3, annex 7).
inline constexpr float kLfeCutoffHz = 120.f;

}  // namespace earshot
