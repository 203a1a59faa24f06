// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace earshot {

/// A delay as the nearest whole sample and the rest, in [-0.5, 0.5].  Delays within 1e-5 of a whole sample count as whole: an unfiltered
/// arrival then is one sample exactly.
struct SplitDelay {
  explicit SplitDelay(double samples);
  std::int64_t whole;
  double part;
};

/// Points of the transform that delays an arrival by a part of a sample without a head: 20 ms, rounded up to a power of two.
int arrival_fft_size(float sample_rate_hz);

/// Adds the circular response to `target` with its sample `zero` at sample `at`: samples up to half a turn before `zero` lie before it.
/// Samples outside of `target` are cut.
void add_circular(std::span<const float> response, int zero, std::int64_t at, std::span<float> target);

/// A unit impulse after `delay_samples`, as a response renders the direct sound of a source for an omnidirectional microphone (before the
/// factor 1 / (4 pi distance)): band-limited, its sample n is time n / rate after emission, and what would ring before sample 0 is cut.
/// As many samples as it takes, a power of two.  delay_samples: at least 0.  About 20 us.
std::vector<float> delayed_impulse(double delay_samples, float sample_rate_hz);

}  // namespace earshot
