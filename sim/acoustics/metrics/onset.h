// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

namespace earshot {

/// Index of the sample at which an impulse response begins: the first one within 20 dB of the strongest (ISO 3382-1:2009, A.3.4), which
/// also stands 14 dB above the noise, the quietest 10 ms of the response.  The latter counts up to half of the strongest sample alone, so
/// that a response of noise has an onset too.  nullopt of silence.  samples: finite.  O(n), safe from any thread.
std::optional<std::size_t> find_onset(std::span<const float> samples, double sample_rate_hz);

}  // namespace earshot
