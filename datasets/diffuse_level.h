// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "sim/audio/head/listener_layout.h"

namespace earshot {

/// Root mean square of a channel in a diffuse field over that of an omnidirectional microphone, before a low-pass: sqrt(a^2 + (1 - a)^2 /
/// 3) for a pattern a + (1 - a) cos, 1 / sqrt(2 degree + 1) for SN3D harmonics, 1 for ears, N3D harmonics and measured patterns.
float diffuse_level(const ListenerLayout& layout, std::size_t channel);

}  // namespace earshot
