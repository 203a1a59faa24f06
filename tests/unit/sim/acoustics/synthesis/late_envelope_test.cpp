// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_envelope.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace earshot {
namespace {

// Any energy that a float can hold, down to the smallest, with any direction of it: envelopes stay finite, and a sample's direction is that
// of its energy wherever the energy has a finite reciprocal.
TEST(LateEnvelope, TheSmallestEnergiesStayFinite) {
  constexpr int bins = 100;  // single ones, and fours
  const float root3 = std::sqrt(3.f);
  EnergyHistogram energy(bins, 1, 1, 0.004f);
  for (int exponent = 0; exponent < 46; ++exponent) {
    const float value = static_cast<float>(std::pow(10.0, -exponent));
    for (int bin = 0; bin < bins; ++bin) {
      float* c = energy.values().data() + 4 * bin;
      c[0] = value;
      for (int k = 1; k < 4; ++k) c[k] = bin % 2 == 0 ? value : bin % 4 == k ? -root3 * value : 0.f;
    }
    for (const double onset : {0.0, 100.0}) {
      LateEnvelope envelope;
      envelope.make(energy, 16000.f, onset, 6400);
      for (const LateEnvelopeSample& sample : envelope.band(0)) {
        ASSERT_TRUE(std::isfinite(sample.density) && std::isfinite(sample.d)) << value;
        for (const float m : sample.m) ASSERT_TRUE(std::isfinite(m)) << value;
      }
      if (value < std::numeric_limits<float>::min()) continue;
      for (const float m : envelope.band(0)[20].m) EXPECT_NEAR(m, 1.f, 1e-5f) << value;  // bin 20: all of it from one side, along (1, 1, 1)
      EXPECT_NEAR(envelope.band(0)[20].d, 0.f, 1e-3f) << value;
    }
  }
}

// A decay of 60 dB in 0.5 s through its bins, single ones and fours, to densities: the mean over a bin and the chord between two lie
// above an exponential by x^2 / 24 and x^2 / 8, together 3.3 % for the x = 0.44 nepers of 16 ms.  Single bins are counted from
// the onset.
TEST(LateEnvelope, TheEnvelopeFollowsTheDecay) {
  constexpr int bins = 250;
  constexpr float bin_s = 0.004f, rate_hz = 16000.f;
  constexpr std::size_t samples = 16000;
  const double per_s = 13.8155 / 0.5, bin = static_cast<double>(bin_s);
  for (const double onset_sample : {0.0, 3000.0}) {
    EnergyHistogram energy(bins, 1, 1, bin_s);
    const int first = static_cast<int>(onset_sample / (bin * 16000));
    for (int i = first; i < bins; ++i)
      energy.values()[static_cast<std::size_t>(4 * i)] =
          static_cast<float>((std::exp(-per_s * i * bin) - std::exp(-per_s * (i + 1) * bin)) / per_s);
    LateEnvelope envelope;
    envelope.make(energy, rate_hz, onset_sample, samples);
    std::size_t next = static_cast<std::size_t>(onset_sample);
    double sum = 0;
    envelope.visit(7000, [&](const LateSegment& segment) {
      EXPECT_EQ(segment.begin, next);
      next += static_cast<std::size_t>(segment.count);
      const auto row = envelope.band(0);
      const Ramp ramp =
          ramp_over(segment, row[static_cast<std::size_t>(segment.left)].density, row[static_cast<std::size_t>(segment.right)].density);
      for (int i = 0; i < segment.count; ++i) {
        const double time_s = static_cast<double>(segment.begin + static_cast<std::size_t>(i)) / 16000;
        const double density = static_cast<double>(ramp.at(i)) * 16000;
        sum += density / 16000;
        // Not where the onset cuts, nor 70 dB down, where bands end.
        if (time_s <= onset_sample / 16000 + 2 * bin || time_s >= onset_sample / 16000 + 0.5) continue;
        ASSERT_NEAR(density / std::exp(-per_s * time_s), 1.015, 0.02) << time_s << " s, onset " << onset_sample;
      }
    });
    EXPECT_EQ(next, samples);
    EXPECT_NEAR(sum * per_s / std::exp(-per_s * first * bin), 1.0, 0.003);
  }
}

// Tables may be shorter than the histogram: what is left is the beginning of the whole.
TEST(LateEnvelope, AShorterResponseIsTheBeginning) {
  constexpr int bins = 250;
  EnergyHistogram energy(bins, 1, 1, 0.004f);
  for (int i = 0; i < bins; ++i) energy.values()[static_cast<std::size_t>(4 * i)] = 1.f + 0.5f * static_cast<float>(i % 7);
  const auto density_of = [&](std::size_t samples) {
    LateEnvelope envelope;
    envelope.make(energy, 16000.f, 0.0, samples);
    std::vector<float> density;
    envelope.visit(16000, [&](const LateSegment& segment) {
      const auto row = envelope.band(0);
      const Ramp ramp =
          ramp_over(segment, row[static_cast<std::size_t>(segment.left)].density, row[static_cast<std::size_t>(segment.right)].density);
      for (int i = 0; i < segment.count; ++i) density.push_back(ramp.at(i));
    });
    return density;
  };
  const std::vector<float> whole = density_of(16000);
  ASSERT_EQ(whole.size(), 16000u);
  for (std::size_t samples = 1000; samples < 8000; samples += 37) {
    const std::vector<float> part = density_of(samples);
    ASSERT_EQ(part.size(), samples);
    ASSERT_TRUE(std::equal(part.begin(), part.end(), whole.begin())) << samples;
  }
}

}  // namespace
}  // namespace earshot
