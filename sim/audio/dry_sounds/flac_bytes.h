// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

namespace earshot {

/// Sound as the bytes of a FLAC file of 16 bits, which browsers play.  channels [num_channels, n] in [-1, 1]; beyond, they are clipped.
/// Throws InputError for sizes or a rate that do not fit, RunError if libsndfile cannot or a sample is not finite.
std::string flac_bytes(std::span<const float> channels, int num_channels, float sample_rate_hz);

}  // namespace earshot
