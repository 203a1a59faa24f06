// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "tests/support/acoustics/late_field.h"

namespace earshot {
namespace {

using namespace rooms;

// The order only adds coefficients: what lower orders hold stays, and no order holds more than its energy (|c_l|^2 <= (2 l + 1) c_0^2).
TEST(HarmonicHistogram, TracersCarryEveryOrderUpToFive) {
  const auto room = box(5, 4, 3, uniform_walls(0.2, 0.5));
  AcousticConfig config;
  config.rays = 64;
  config.rir_length_s = 0.1f;
  config.sh_order = 5;
  const EnergyHistogram five = late_field(room, config, point(1, 1, 1), point(3.5, 2.5, 1.5));
  ASSERT_EQ(five.num_coefficients(), 36);
  double highest = 0;
  for (int order = 0; order < 5; ++order) {
    config.sh_order = order;
    const EnergyHistogram lower = late_field(room, config, point(1, 1, 1), point(3.5, 2.5, 1.5));
    ASSERT_EQ(lower.num_coefficients(), (order + 1) * (order + 1));
    for (int bin = 0; bin < five.num_bins(); ++bin)
      for (int band = 0; band < five.num_bands(); ++band)
        for (std::size_t c = 0; c < static_cast<std::size_t>(lower.num_coefficients()); ++c)
          ASSERT_NEAR(lower.at(bin, band)[c], five.at(bin, band)[c], 2e-6f * five.energy(bin, band)) << order << " acn " << c;
  }
  for (int bin = 0; bin < five.num_bins(); ++bin) {
    for (int band = 0; band < five.num_bands(); ++band) {
      const auto cell = five.at(bin, band);
      const double energy = static_cast<double>(cell[0]);
      for (std::size_t l = 1; l <= 5; ++l) {
        double square = 0;
        for (std::size_t c = l * l; c < (l + 1) * (l + 1); ++c) square += static_cast<double>(cell[c]) * static_cast<double>(cell[c]);
        ASSERT_LE(square, (1.0 + 1e-4) * static_cast<double>(2 * l + 1) * energy * energy) << l;
        if (l == 5) highest += square;
      }
    }
  }
  EXPECT_GT(highest, 0.0);
}

}  // namespace
}  // namespace earshot
