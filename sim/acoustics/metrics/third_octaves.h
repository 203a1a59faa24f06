// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Third octaves at 100 Hz ... 10 kHz (exact midbands 1000 * 10^(0.1 k), IEC 61260-1:2014), for responses in samples.  Bands that start
/// above rate / 2 are dropped and the last edge is clipped, as in BandLayout::octaves.
BandLayout third_octaves(float sample_rate_hz);

}  // namespace earshot
