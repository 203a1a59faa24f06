// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envs/config/env_config.h"

namespace earshot {

/// Raises acoustics.sh_order to the order of ambisonic channels, as far as sound is traced by directions: the late field then has the
/// harmonics that they need, as in `earshot rir`.  Other channels change nothing.  Throws InputError: the channels have no such order.
void raise_order_to_channels(EnvConfig& config);

}  // namespace earshot
