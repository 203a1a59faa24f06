// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/binaural_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <vector>

#include "sim/audio/head/hrtf.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

// The two noises of a band are uncorrelated, and have the powers that a diffuse field has through the decoder.
TEST(BinauralNoise, MixesADiffuseFieldBackToItself) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank carriers(bands, 16000.f, 4, 1 << 14, 0);
  const BinauralNoise noise(carriers, bands, *head);
  const auto bins = static_cast<std::size_t>(head->fft_size() / 2 + 1);
  double expected = 0;
  for (std::size_t k = 0; k < bins; ++k)
    for (int c = 0; c < 4; ++c) expected += std::norm(head->diffuse_decoder(c, 0)[k]) / static_cast<double>(bins);
  std::vector<float> whole_left(1 << 14), whole_right(1 << 14);
  for (int band = 0; band < bands.size(); ++band) {
    const BinauralNoise::Mix mix = noise.mix(band, {0, 0, 0});
    double both = 0;
    const auto first = noise.loop(band, 0), second = noise.loop(band, 1);
    for (std::size_t n = 0; n < first.size(); ++n) {
      both += static_cast<double>(first[n]) * static_cast<double>(second[n]);
      whole_left[n] += mix.left * first[n];
      whole_right[n] += mix.shared * first[n] + mix.own * second[n];
    }
    EXPECT_NEAR(both / std::sqrt(energy_of(first) * energy_of(second)), 0.0, 1e-4) << band;
  }
  const double left = energy_of(whole_left) / static_cast<double>(whole_left.size());
  const double right = energy_of(whole_right) / static_cast<double>(whole_right.size());
  EXPECT_NEAR(db(left / expected), 0.0, 0.1);
  EXPECT_NEAR(db(right / expected), 0.0, 0.1);
}

// Whatever direction a bin claims, even one past its own energy, its mixes are finite.
TEST(BinauralNoise, StaysFiniteForEveryDirection) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank carriers(bands, 16000.f, 4, 4096, 0);
  const BinauralNoise noise(carriers, bands, *Hrtf::rigid_sphere(16000.f));
  for (int band = 0; band < bands.size(); ++band)
    for (const float size : {0.f, 1e-20f, 0.5f, 1.7320508f, 2.f})
      for (const glm::vec3 side :
           {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, 0, 1), glm::vec3(0.6f, 0.8f, 0)}) {
        const BinauralNoise::Mix mix = noise.mix(band, {size * side.x, size * side.y, size * side.z});
        for (const float factor : {mix.left, mix.shared, mix.own}) ASSERT_TRUE(std::isfinite(factor) && std::abs(factor) < 4.f);
        EXPECT_GE(mix.left, 0.f);
        EXPECT_GE(mix.own, 0.f);
      }
}

}  // namespace
}  // namespace earshot
