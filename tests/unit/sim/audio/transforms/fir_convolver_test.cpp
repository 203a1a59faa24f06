// SPDX-License-Identifier: Apache-2.0
// Convolution by overlap-add beside the sum that defines it.

#include "sim/audio/transforms/fir_convolver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace earshot {
namespace {

std::vector<float> twister_noise(std::size_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> uniform(-1, 1);
  std::vector<float> values(count);
  for (float& value : values) value = uniform(generator);
  return values;
}

TEST(FirConvolver, IsTheSumOfProducts) {
  FirConvolver convolver;
  // Signals shorter and longer than a hop, filters of one tap, of an odd number and of more than the signal.
  for (const auto& [samples, taps] : {std::pair<std::size_t, std::size_t>{1, 1}, {3000, 1}, {2500, 701}, {40, 900}, {1024, 512}}) {
    const std::vector<float> signal = twister_noise(samples, 1), filters = twister_noise(2 * taps, 2);
    const std::vector<float> result = convolver.convolve(signal, filters, 2);
    const std::size_t frames = samples + taps - 1;
    ASSERT_EQ(result.size(), 2 * frames);
    for (std::size_t channel = 0; channel < 2; ++channel)
      for (std::size_t n = 0; n < frames; ++n) {
        double sum = 0;
        for (std::size_t k = 0; k < taps; ++k)
          if (n >= k && n - k < samples) sum += static_cast<double>(signal[n - k]) * static_cast<double>(filters[channel * taps + k]);
        // Transforms of 2048 floats of magnitude 1: rounding of 6e-8 times the root of the number of products, with a factor of ten.
        ASSERT_NEAR(result[channel * frames + n], sum, 2e-5) << samples << " " << taps << " " << n;
      }
  }
}

TEST(FirConvolver, NothingStaysNothing) {
  FirConvolver convolver;
  EXPECT_TRUE(convolver.convolve({}, std::vector<float>{1, 2}, 1).empty());
}

}  // namespace
}  // namespace earshot
