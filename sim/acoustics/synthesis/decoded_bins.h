// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "sim/acoustics/synthesis/late_envelope.h"

namespace earshot {

/// Merged bins to decode: those of decode_samples behind the first sound; where more sound comes from one side for long, as beside a door,
/// up to all but the last hundredth of the energy.  The mean is over all that is left, so that the noise of single bins does not count.
/// before: scratch.
int bins_to_decode(const LateEnvelope& envelope, double decode_samples, std::vector<float>& before);

}  // namespace earshot
