// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/audio/head/listener_layout.h"

namespace earshot {

/// Highest order of the harmonics of the late field, AcousticConfig::sh_order.
inline constexpr int kTracedOrder = 5;

/// Order of the harmonics that the late field needs for these channels: 0 for one omnidirectional microphone; that of ambisonic channels,
/// between the config's and kTracedOrder; the config's for others.
inline int harmonics_of(const ListenerLayout& layout, const AcousticConfig& config) {
  if (layout.kind == ListenerKind::mono) return 0;
  if (layout.kind == ListenerKind::ambisonics) return std::clamp(layout.order, config.sh_order, kTracedOrder);
  return config.sh_order;
}

}  // namespace earshot
