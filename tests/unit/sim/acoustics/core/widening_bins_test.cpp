// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/widening_bins.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/acoustics/source_field/field_image.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

TEST(WideningBins, EveryBinIsInOneMergedBin) {
  for (const std::size_t onset : {0, 1, 60})
    for (const int num_bins : {1, 2, 39, 40, 41, 44, 100, 377}) {
      const WideningBins bins(num_bins, onset);
      EXPECT_EQ(bins.fine(), std::min(WideningBins::kFine + onset, static_cast<std::size_t>(num_bins)));
      std::size_t next = 0;
      for (std::size_t merged = 0; merged < bins.size(); ++merged) {
        EXPECT_EQ(bins.first_bin(merged), next);
        EXPECT_TRUE(merged < bins.fine() ? bins.width(merged) == 1 : bins.width(merged) >= 1 && bins.width(merged) <= WideningBins::kWide);
        EXPECT_DOUBLE_EQ(bins.middle(merged), static_cast<double>(next) + 0.5 * static_cast<double>(bins.width(merged)));
        for (std::size_t i = 0; i < bins.width(merged); ++i) EXPECT_EQ(bins.merged_bin_of(next++), merged);
      }
      EXPECT_EQ(next, static_cast<std::size_t>(num_bins));
    }
}

// Late energy of a diffuse room falls by the same fraction from bin to bin, inside the merged bins as from merged bin to merged bin: three
// quarters of a merged bin's fall lie between the first and the last of its four bins.  Steps would give none of it.
TEST(WideningBins, AFieldFallsInsideAMergedBinAsItDoesOutside) {
  AcousticConfig config = rooms::plain_config();
  config.field_photons = 16'384;
  config.field_error = 1e-6f;
  config.field_cell_m = 1.f;
  config.time_bin_s = 0.004f;
  config.rir_length_s = 0.8f;
  const AcousticScene scene(rooms::shoe1(0.1, 1), config);
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  EnergyHistogram late = make_histogram(scene);
  build_source_field(scene, candidates)->gather(scene, rooms::shoe1_listener(), late);
  const WideningBins bins = field_bins(scene, late.num_bins());
  const auto energy = [&](std::size_t bin) { return double{late.energy(static_cast<int>(bin), 0)}; };
  const auto sum_of = [&](std::size_t merged) {
    double sum = 0;
    for (std::size_t i = 0; i < WideningBins::kWide; ++i) sum += energy(bins.first_bin(merged) + i);
    return sum;
  };
  double inside = 0, outside = 0;
  const std::size_t first = bins.fine(), end = bins.merged_bin_of(static_cast<std::size_t>(0.6f / late.bin_s()));
  for (std::size_t merged = first; merged < end; ++merged) {
    const std::size_t bin = bins.first_bin(merged);
    for (std::size_t i = 0; i < WideningBins::kWide; ++i) ASSERT_GT(energy(bin + i), 0.0) << merged;
    inside += std::log(energy(bin) / energy(bin + WideningBins::kWide - 1));
    outside += std::log(sum_of(merged) / sum_of(merged + 1));
  }
  EXPECT_GT(outside, 5.0) << "20 dB and more of decay, or nothing is tested";
  // A line in place of the exponential makes 0.76 of it, at 0.2 nepers a merged bin.
  EXPECT_NEAR(inside / outside, 0.75, 0.05);
}

// Listeners sum a few thousand values at a time: with 36 harmonics that is 14 merged bins, with one it is all of them.
TEST(WideningBins, AFieldIsTheSameInBlocksOfAnyLength) {
  AcousticConfig config = rooms::plain_config();
  config.field_photons = 1024;
  config.field_cell_m = 1.f;
  config.time_bin_s = 0.004f;
  config.rir_length_s = 0.8f;
  std::vector<double> energy[2];
  for (const int order : {0, 5}) {
    config.sh_order = order;
    const AcousticScene scene(rooms::shoe1(0.1, 1), config);
    const EarlyCandidates candidates(scene, rooms::shoe1_source());
    EnergyHistogram late = make_histogram(scene);
    build_source_field(scene, candidates)->gather(scene, rooms::shoe1_listener(), late);
    energy[order == 5] = late.band_energy(0);
  }
  EXPECT_GT(energy[0].back(), 0);
  EXPECT_EQ(energy[0], energy[1]);
}

}  // namespace
}  // namespace earshot
