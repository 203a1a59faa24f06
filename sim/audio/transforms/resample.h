// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

namespace earshot {

/// Sample rates of sounds and of measured filters.
inline constexpr double kMinRateHz = 1000, kMaxRateHz = 768000;

/// `input` at another rate, by the library that EARSHOT_AUDIO_LIBRARIES chooses (docs/dependencies.md): sample n of the result is the sound
/// at time n / to_hz, round(input.size() * to_hz / from_hz) samples, at least one.  Passband to 97 % of the lower Nyquist rate.
/// from_hz, to_hz: in [kMinRateHz, kMaxRateHz].  name: of the sound, for messages.  Throws InputError where the library refuses the rates.
std::vector<float> resample(std::span<const float> input, int from_hz, int to_hz, const std::string& name);

}  // namespace earshot
