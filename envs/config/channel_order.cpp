// SPDX-License-Identifier: Apache-2.0
#include "envs/config/channel_order.h"

#include <algorithm>

namespace earshot {
namespace {

/// The late field carries harmonics up to here.
constexpr int kTracedOrder = 5;

}  // namespace

void raise_order_to_channels(EnvConfig& config) {
  if (!config.observation.channels.starts_with("ambisonic")) return;
  config.acoustics.sh_order = std::clamp(config.observation.layout().order, config.acoustics.sh_order, kTracedOrder);
}

}  // namespace earshot
