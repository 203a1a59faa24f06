// SPDX-License-Identifier: Apache-2.0
#include "datasets/diffuse_level.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/audio/head/directivity.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Mean of the squared pattern over evenly spread directions: an independent integral over the sphere.
double mean_square(double omni_weight) {
  constexpr int num_rings = 2000;
  double sum = 0;
  for (int ring = 0; ring < num_rings; ++ring) {
    const double cosine = -1 + (2 * ring + 1.) / num_rings, gain = omni_weight + (1 - omni_weight) * cosine;
    sum += gain * gain / num_rings;
  }
  return sum;
}

TEST(DiffuseLevel, IsTheMeanOfThePatternOverAllDirections) {
  const ListenerLayout surround = ListenerLayout::named("surround_7_1"), pair = ListenerLayout::named("stereo:ms");
  EXPECT_NEAR(diffuse_level(surround, 0), std::sqrt(mean_square(0.5)), 1e-5);
  EXPECT_FLOAT_EQ(diffuse_level(surround, 3), 1) << "low-frequency channel";
  EXPECT_NEAR(diffuse_level(pair, 1), std::sqrt(mean_square(0)), 1e-5) << "dipole";
  const RandomStream random(5, Purpose::test);
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const float omni_weight = random.uniform(draw);
    const ListenerLayout array = ListenerLayout::array({{.directivity = Directivity::first_order(omni_weight)}});
    EXPECT_NEAR(diffuse_level(array, 0), std::sqrt(mean_square(static_cast<double>(omni_weight))), 1e-5) << omni_weight;
  }
}

TEST(DiffuseLevel, OfHarmonicsFollowsTheirNorm) {
  const ListenerLayout n3d = ListenerLayout::ambisonics(2), sn3d = ListenerLayout::ambisonics(2, HarmonicNorm::sn3d);
  for (std::size_t channel = 0; channel < 9; ++channel) {
    EXPECT_EQ(diffuse_level(n3d, channel), 1);
    EXPECT_NEAR(diffuse_level(sn3d, channel), std::sqrt(1 / (channel == 0 ? 1. : channel < 4 ? 3. : 5.)), 1e-6) << channel;
  }
}

}  // namespace
}  // namespace earshot
