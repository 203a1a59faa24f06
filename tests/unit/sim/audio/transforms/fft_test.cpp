// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/fft.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "tests/support/acoustics/stream_sounds.h"

namespace earshot {
namespace {

std::vector<std::complex<float>> spectrum_of(RealFft& fft, std::span<const float> time) {
  std::vector<std::complex<float>> spectrum(fft.num_bins());
  fft.forward(time, spectrum);
  return spectrum;
}

/// One bin of the definition, in double.
std::complex<double> naive_bin(std::span<const float> time, int k) {
  std::complex<double> sum = 0;
  const auto size = static_cast<std::int64_t>(time.size());
  for (std::int64_t n = 0; n < size; ++n)
    sum += static_cast<double>(time[n]) *
           std::polar(1.0, -2.0 * std::numbers::pi * static_cast<double>(n * k % size) / static_cast<double>(size));
  return sum;
}

// Rounding of a float transform grows like log2(N) * 6e-8 relative to the rms of a bin, sqrt(N / 3) here; 1e-6 leaves room.
TEST(RealFft, EqualsTheDefinition) {
  for (int size = 4; size <= 4096; size *= 2) {
    RealFft fft(size);
    const auto time = stream_sounds::noise(size, static_cast<std::uint32_t>(size));
    const auto spectrum = spectrum_of(fft, time);
    const double rms = std::sqrt(size / 3.0);
    for (int k = 0; k < fft.num_bins(); ++k)
      ASSERT_LT(std::abs(naive_bin(time, k) - std::complex<double>(spectrum[k])), 2e-6 * rms) << "size " << size << " bin " << k;
  }
}

// Beyond 2^17 the transform is our own four-step one: odd and even powers split into different shapes.
TEST(RealFft, LargeSizesEqualTheDefinition) {
  for (const int size : {1 << 17, 1 << 18, 1 << 19}) {
    RealFft fft(size);
    const auto time = stream_sounds::noise(size, 3);
    const auto spectrum = spectrum_of(fft, time);
    for (const int k : {0, 1, 2, 777, size / 4, size / 4 + 1, size / 2 - 1, size / 2})
      EXPECT_LT(std::abs(naive_bin(time, k) - std::complex<double>(spectrum[k])), 2e-6 * std::sqrt(size / 3.0)) << size << " bin " << k;
  }
}

TEST(RealFft, InverseUndoesForward) {
  for (int size = 4; size <= 1 << 20; size *= 2) {
    RealFft fft(size);
    const auto time = stream_sounds::noise(size, 1);
    std::vector<float> back(size);
    fft.inverse(spectrum_of(fft, time), back);
    float worst = 0;
    for (int i = 0; i < size; ++i) worst = std::max(worst, std::abs(back[i] - time[i]));
    EXPECT_LT(worst, 2e-6f) << size;
  }
}

TEST(RealFft, InverseOfOneLineIsACosine) {
  for (const int size : {64, 1 << 19}) {
    RealFft fft(size);
    std::vector<std::complex<float>> spectrum(fft.num_bins());
    spectrum[5] = {0.f, static_cast<float>(size) / 2.f};  // i/2 (e^{iwt} - e^{-iwt}) = -sin(wt)
    std::vector<float> time(size);
    fft.inverse(spectrum, time);
    for (int i = 0; i < size; i += size / 64) EXPECT_NEAR(time[i], -std::sin(2.0 * std::numbers::pi * 5.0 * i / size), 1e-6);
  }
}

TEST(RealFft, IsLinear) {
  RealFft fft(1024);
  const auto a = stream_sounds::noise(1024, 1), b = stream_sounds::noise(1024, 2);
  std::vector<float> sum(1024);
  for (int i = 0; i < 1024; ++i) sum[i] = 3.f * a[i] - 0.5f * b[i];
  const auto sa = spectrum_of(fft, a), sb = spectrum_of(fft, b), ss = spectrum_of(fft, sum);
  for (int k = 0; k < fft.num_bins(); ++k) EXPECT_LT(std::abs(ss[k] - (3.f * sa[k] - 0.5f * sb[k])), 2e-4f);
}

TEST(RealFft, ScalingByAPowerOfTwoScalesTheBits) {
  for (const int size : {512, 1 << 18}) {
    RealFft fft(size);
    auto time = stream_sounds::noise(size, 4);
    const auto before = spectrum_of(fft, time);
    for (float& value : time) value *= 1048576.f;
    const auto after = spectrum_of(fft, time);
    for (int k = 0; k < fft.num_bins(); ++k) ASSERT_EQ(after[k], before[k] * 1048576.f);
  }
}

TEST(RealFft, KeepsEnergy) {  // Parseval
  for (const int size : {256, 1 << 18}) {
    RealFft fft(size);
    const auto time = stream_sounds::noise(size, 5);
    const auto spectrum = spectrum_of(fft, time);
    double in_time = 0, in_frequency = 0;
    for (const float value : time) in_time += static_cast<double>(value) * value;
    for (int k = 0; k < fft.num_bins(); ++k)
      in_frequency += (k == 0 || k == size / 2 ? 1.0 : 2.0) * std::norm(std::complex<double>(spectrum[k]));
    EXPECT_NEAR(in_frequency / size / in_time, 1.0, 1e-6);
  }
}

TEST(RealFft, ShortInputIsPaddedWithZeros) {
  for (const int size : {64, 1 << 18}) {
    RealFft fft(size);
    auto time = stream_sounds::noise(size, 6);
    spectrum_of(fft, time);  // leaves scratch dirty
    std::fill(time.begin() + 10, time.end(), 0.f);
    EXPECT_EQ(spectrum_of(fft, time), spectrum_of(fft, std::span(time).first(10)));
  }
}

// An inverse transform of bins without a meaning must not come back in the next forward one.
TEST(RealFft, ForwardDoesNotRememberTheInverseBeforeIt) {
  for (const int size : {16, 1024, 16384}) {
    RealFft fft(size), fresh(size);
    std::vector<std::complex<float>> bins(static_cast<std::size_t>(fft.num_bins()), {1.f, 1.f});
    std::vector<float> time(static_cast<std::size_t>(size));
    fft.inverse(bins, time);
    const auto input = stream_sounds::noise(size, 3);
    const auto after = spectrum_of(fft, input), expected = spectrum_of(fresh, input);
    EXPECT_EQ(after, expected) << size;
    EXPECT_EQ(after.back().imag(), 0.f) << size;
    EXPECT_EQ(after.front().imag(), 0.f) << size;
  }
}

TEST(RealFft, RefusesOtherSizes) {
  for (const int size : {-8, 0, 2, 3, 6, 1000, 1 << 25}) EXPECT_THROW(RealFft{size}, InputError) << size;
}

TEST(NextPowerOfTwo, RoundsUp) {
  EXPECT_EQ(next_power_of_two(0), 1);
  EXPECT_EQ(next_power_of_two(1), 1);
  EXPECT_EQ(next_power_of_two(5), 8);
  EXPECT_EQ(next_power_of_two(8192), 8192);
  EXPECT_EQ(next_power_of_two(8193), 16384);
}

}  // namespace
}  // namespace earshot
