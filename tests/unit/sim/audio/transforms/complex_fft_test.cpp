// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/complex_fft.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "tests/support/acoustics/stream_sounds.h"

namespace earshot {
namespace {

TEST(ComplexFft, TwoRealSignalsGiveTheSumOfTheirDefinitions) {
  constexpr int size = 64;
  const auto a = stream_sounds::noise(40, 1), b = stream_sounds::noise(40, 2);
  ComplexFft fft(size, ComplexFft::Direction::forward);
  fft.set_input(a, b);
  const auto spectrum = fft.transform();
  for (int k = 0; k < size; ++k) {
    std::complex<double> expected = 0;
    for (std::size_t n = 0; n < a.size(); ++n)
      expected += std::complex<double>(a[n], b[n]) * std::polar(1.0, -2.0 * std::numbers::pi * k * static_cast<double>(n) / size);
    EXPECT_NEAR(spectrum[static_cast<std::size_t>(k)].real(), expected.real(), 1e-5) << k;  // values about 6, six stages of 1e-7
    EXPECT_NEAR(spectrum[static_cast<std::size_t>(k)].imag(), expected.imag(), 1e-5) << k;
  }
}

TEST(ComplexFft, InverseUndoesForwardTimesTheSize) {
  for (const int size : {16, 512, 2048, 1 << 14}) {
    const auto a = stream_sounds::noise(static_cast<std::size_t>(size), 1), b = stream_sounds::noise(static_cast<std::size_t>(size), 2);
    ComplexFft forward(size, ComplexFft::Direction::forward), inverse(size, ComplexFft::Direction::inverse);
    AlignedSpectrum spectrum(static_cast<std::size_t>(size));
    forward.set_input(a, b);
    forward.transform(spectrum);
    std::ranges::copy(spectrum, inverse.input().begin());
    const auto back = inverse.transform();
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_NEAR(back[i].real() / static_cast<float>(size), a[i], 2e-6) << size;
      ASSERT_NEAR(back[i].imag() / static_cast<float>(size), b[i], 2e-6) << size;
    }
  }
}

TEST(ComplexFft, AbsentSecondSignalIsZero) {
  ComplexFft one(256, ComplexFft::Direction::forward), two(256, ComplexFft::Direction::forward);
  const auto a = stream_sounds::noise(100, 1);
  one.set_input(stream_sounds::noise(256, 3), stream_sounds::noise(256, 4));  // leaves scratch dirty
  one.transform();
  one.set_input(a, {});
  two.set_input(a, std::vector<float>(100, 0.f));
  const auto x = one.transform(), y = two.transform();
  EXPECT_TRUE(std::equal(x.begin(), x.end(), y.begin(), y.end()));
}

TEST(ComplexFft, RefusesNonsense) {
  for (const int size : {0, 8, 48, 1 << 18}) EXPECT_THROW(ComplexFft(size, ComplexFft::Direction::forward), InputError);
}

}  // namespace
}  // namespace earshot
