// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/bands.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

TEST(Bands, OctavesHaveExactMidbandsAndEndAtNyquist) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const double centre_hz[] = {125.9, 251.2, 501.2, 1000,
                              1995,  3981,  6707};  // the last: sqrt(5623.4 * 8000); docs/evidence/oracles.md, Conventions, four digits
  ASSERT_EQ(bands.size(), 7);
  ASSERT_EQ(bands.edge_hz.size(), 8u);
  for (int i = 0; i < 7; ++i) {
    EXPECT_NEAR(bands.centre_hz[i], centre_hz[i], 4e-4 * centre_hz[i]);
    EXPECT_LT(bands.edge_hz[i], bands.centre_hz[i]);
    EXPECT_GT(bands.edge_hz[i + 1], bands.centre_hz[i]);
  }
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(bands.edge_hz[i + 1] / bands.edge_hz[i], 1.995262, 1e-5);  // 10^0.3
    EXPECT_NEAR(bands.edge_hz[i] * bands.edge_hz[i + 1], bands.centre_hz[i] * bands.centre_hz[i],
                1e-4 * bands.centre_hz[i] * bands.centre_hz[i]);
  }
  EXPECT_EQ(bands.edge_hz[7], 8000.f);
}

TEST(Bands, OctavesOfOtherRatesH31) {
  EXPECT_EQ(BandLayout::octaves(8000.f).size(), 6);
  EXPECT_EQ(BandLayout::octaves(8000.f).edge_hz.back(), 4000.f);
  EXPECT_EQ(BandLayout::octaves(11025.f).size(), 6);  // the 8 kHz octave begins at 5623 Hz
  for (const float rate : {22050.f, 44100.f, 48000.f, 96000.f}) {
    const BandLayout bands = BandLayout::octaves(rate);
    EXPECT_EQ(bands.size(), rate > 28271 ? 8 : 7) << rate;  // a third of the 16 kHz octave: 11220 * 10^0.1 = 14125 Hz
    EXPECT_LE(bands.edge_hz.back(), rate / 2);
  }
  EXPECT_NEAR(BandLayout::octaves(48000.f).edge_hz.back(), 22387.2f, 0.1f);
  EXPECT_EQ(BandLayout::octaves(12000.f).size(), 6);  // 0.1 octave above 5623 Hz is no band
  EXPECT_EQ(BandLayout::octaves(28000.f).size(), 7);
  EXPECT_EQ(BandLayout::octaves(28500.f).size(), 8);
}

TEST(Bands, TheLowOctaveIsOneMore) {
  for (const float rate : {8000.f, 11025.f, 16000.f, 22050.f, 44100.f, 48000.f, 96000.f}) {
    const BandLayout usual = BandLayout::octaves(rate), low = BandLayout::octaves(rate, true);
    ASSERT_EQ(low.size(), usual.size() + 1);
    EXPECT_NEAR(low.centre_hz[0], 63.0957f, 1e-3f);
    EXPECT_NEAR(low.edge_hz[0], 44.6684f, 1e-3f);
    EXPECT_EQ(std::vector<float>(low.centre_hz.begin() + 1, low.centre_hz.end()), usual.centre_hz);
    EXPECT_EQ(std::vector<float>(low.edge_hz.begin() + 1, low.edge_hz.end()), usual.edge_hz);
  }
}

// Half the rate cuts a band at any place of it: the centre is the geometric mean of what is left, and grows steadily with the rate.
TEST(Bands, ClippedBandsHaveTheirCentreInTheMiddle) {
  for (std::uint32_t draw = 0; draw < 20; ++draw) {
    const RandomStream random(38, Purpose::test, 20, draw);
    const auto rate = 8000.f + 40000.f * random.uniform(0);
    const int count = 1 + static_cast<int>(random.below(32, 1));
    for (const BandLayout& bands : {BandLayout::octaves(rate), BandLayout::third_octaves(rate), BandLayout::log_spaced(count, rate)}) {
      const double low = double{bands.edge_hz[bands.edge_hz.size() - 2]}, high = double{bands.edge_hz.back()};
      EXPECT_NEAR(double{bands.centre_hz.back()}, std::sqrt(low * high), 1e-4 * high) << rate;
    }
  }
}

TEST(Bands, LogSpacedO31) {
  const auto expect = [](int count, std::vector<float> edges, std::vector<float> centres) {
    const BandLayout bands = BandLayout::log_spaced(count, 48000.f);
    ASSERT_EQ(bands.size(), count);
    for (std::size_t i = 0; i < edges.size(); ++i) EXPECT_NEAR(bands.edge_hz[i], edges[i], 1e-4f * edges[i]);
    for (std::size_t i = 0; i < centres.size(); ++i) EXPECT_NEAR(bands.centre_hz[i], centres[i], 1e-4f * centres[i]);
  };
  expect(1, {44.194f, 11313.7f}, {707.11f});
  expect(2, {44.194f, 707.11f, 11313.7f}, {176.78f, 2828.4f});
  expect(3, {44.194f, 280.62f, 1781.8f, 11313.7f}, {111.36f, 707.11f, 4489.8f});
  expect(4, {44.194f, 176.78f, 707.11f, 2828.4f, 11313.7f}, {88.388f, 353.55f, 1414.2f, 5656.9f});
  expect(6, {44.194f, 111.36f, 280.62f, 707.11f, 1781.8f, 4489.8f, 11313.7f}, {70.154f, 176.78f, 445.45f, 1122.5f, 2828.4f, 7127.2f});
  expect(8, {44.194f, 88.388f, 176.78f, 353.55f, 707.11f, 1414.2f, 2828.4f, 5656.9f, 11313.7f},
         {62.5f, 125.f, 250.f, 500.f, 1000.f, 2000.f, 4000.f, 8000.f});
}

TEST(Bands, LogSpacedIsClippedAtNyquistO31) {
  const BandLayout bands = BandLayout::log_spaced(8, 8000.f);
  EXPECT_EQ(bands.size(), 7);
  EXPECT_EQ(bands.edge_hz.back(), 4000.f);
  for (const int count : {1, 2, 3, 4, 5, 8, 12, 16, 31, 32}) {  // H-29
    const BandLayout spaced = BandLayout::log_spaced(count, 16000.f);
    EXPECT_EQ(spaced.edge_hz.size(), spaced.centre_hz.size() + 1);
    for (int i = 0; i < spaced.size(); ++i) {
      EXPECT_LT(spaced.edge_hz[i], spaced.edge_hz[i + 1]);
      EXPECT_GT(spaced.centre_hz[i], spaced.edge_hz[i]);
      EXPECT_LE(spaced.centre_hz[i], spaced.edge_hz[i + 1]);
    }
  }
}

TEST(Bands, RefusesImpossibleCountsH30) {
  EXPECT_THROW(BandLayout::log_spaced(0, 16000.f), InputError);
  EXPECT_THROW(BandLayout::log_spaced(kMaxBands + 1, 16000.f), InputError);
}

}  // namespace
}  // namespace earshot
