// SPDX-License-Identifier: Apache-2.0
#include "envs/config/channel_order.h"

#include "sim/acoustics/synthesis/channel_order.h"

namespace earshot {

void raise_order_to_channels(EnvConfig& config) {
  if (!config.observation.channels.starts_with("ambisonic")) return;
  config.acoustics.sh_order = harmonics_of(config.observation.layout(), config.acoustics);
}

}  // namespace earshot
