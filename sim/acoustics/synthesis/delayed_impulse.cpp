// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/delayed_impulse.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>

#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kWholeSample = 1e-5, kArrivalS = 0.02;

}  // namespace

SplitDelay::SplitDelay(double samples) : whole(std::llround(samples)), part(samples - static_cast<double>(whole)) {
  if (std::abs(part) < kWholeSample) part = 0;
}

int arrival_fft_size(float sample_rate_hz) {
  return next_power_of_two(static_cast<int>(std::ceil(kArrivalS * static_cast<double>(sample_rate_hz))));
}

void add_circular(std::span<const float> response, int zero, std::int64_t at, std::span<float> target) {
  const auto size = static_cast<std::int64_t>(response.size()), length = static_cast<std::int64_t>(target.size());
  const std::int64_t first = at - size / 2;  // target sample of the earliest one
  const std::int64_t begin = std::max<std::int64_t>(0, -first), end = std::min(size, length - first);
  // The response is cut at `seam` where its index wraps.
  const std::int64_t start = ((zero - size / 2) % size + size) % size, seam = size - start;
  for (std::int64_t i = begin; i < std::min(end, seam); ++i)
    target[static_cast<std::size_t>(first + i)] += response[static_cast<std::size_t>(start + i)];
  for (std::int64_t i = std::max(begin, seam); i < end; ++i)
    target[static_cast<std::size_t>(first + i)] += response[static_cast<std::size_t>(i - seam)];
}

std::vector<float> delayed_impulse(double delay_samples, float sample_rate_hz) {
  EARSHOT_EXPECT(delay_samples >= 0);
  const SplitDelay delay(delay_samples);
  const int size = arrival_fft_size(sample_rate_hz);
  const auto whole = static_cast<std::size_t>(delay.whole);
  std::vector<float> impulse(static_cast<std::size_t>(next_power_of_two(static_cast<int>(whole) + size / 2 + 1)), 0.f);
  if (delay.part == 0) {
    impulse[whole] = 1;
    return impulse;
  }
  RealFft fft(size);
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()), 1.f);
  std::vector<float> response(static_cast<std::size_t>(size));
  delay_spectrum(spectrum, delay.part, size);
  fft.inverse(spectrum, response);
  add_circular(response, 0, delay.whole, impulse);
  return impulse;
}

}  // namespace earshot
