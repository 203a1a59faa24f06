// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/population_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "sim/base/random.h"

namespace earshot {
namespace {

struct Ray {
  float reflected[8] = {};
  bool alive = true;
};

TEST(PopulationControl, RouletteWithFixedProbabilitiesKeepsEveryBand) {
  // Two rays far down, of which one may stay: the first with probability q (docs/explanation/estimators.md, section 5).  Bands differ by a
  // factor that q does not know.
  for (const double q : {0.1, 0.3, 0.5, 0.7, 0.9}) {
    constexpr int draws = 1000;
    std::array<double, 8> mean{};
    double first_stays = 0;
    for (int draw = 0; draw < draws; ++draw) {
      std::array<Ray, 2> rays;
      for (int band = 0; band < 2; ++band) {
        // The weight of a ray is the mean over bands of its fraction of the band: q for the first one, as q + d and q - d.
        const double fraction = band == 0 ? q + 0.05 : q - 0.05;
        const double level = band == 0 ? 1e-6 : 1e-8;
        rays[0].reflected[band] = static_cast<float>(level * fraction);
        rays[1].reflected[band] = static_cast<float>(level * (1 - fraction));
      }
      control_population<8>(2, std::span<Ray>(rays), (draw + 0.5) / draws);
      ASSERT_NE(rays[0].alive, rays[1].alive);
      first_stays += rays[0].alive ? 1.0 / draws : 0.0;
      for (const Ray& ray : rays) {
        for (int band = 0; ray.alive && band < 2; ++band) mean[band] += double{ray.reflected[band]} / draws;
      }
    }
    EXPECT_NEAR(first_stays, q, 1.5 / draws);  // stratified draws: within one of them
    EXPECT_NEAR(mean[0], 1e-6, 5e-3 * 1e-6) << q;
    EXPECT_NEAR(mean[1], 1e-8, 5e-3 * 1e-8) << q;
  }
}

struct SplitRay : Ray {
  float split = 1;
};

// In a group as in a chunk: the factor on a ray's energy is on its split too, and the energy of all stays.
TEST(PopulationControl, GroupsKeepTheFactorOfSplitting) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(517, Purpose::test, number);
    std::vector<SplitRay> group(40);
    double before = 0;
    for (std::uint32_t i = 0; i < group.size(); ++i) before += double{group[i].reflected[0] = std::pow(random.uniform(i), 6.f) + 1e-4f};
    const std::vector<SplitRay> started = group;
    double peak = 0, after = 0;
    control_group<8>(1, group, 40, peak, double{random.uniform(99)});
    bool any_changed = false;
    for (const SplitRay& ray : group) {
      after += double{ray.reflected[0]};
      any_changed = any_changed || ray.split != 1.f;
      const bool known = std::any_of(started.begin(), started.end(), [&](const SplitRay& from) {
        return std::abs(ray.reflected[0] - from.reflected[0] * ray.split) < 1e-5f * ray.reflected[0];
      });
      EXPECT_TRUE(known) << number;
    }
    EXPECT_TRUE(any_changed) << number;
    EXPECT_NEAR(after, before, 1e-5 * before) << number;
  }
}

}  // namespace
}  // namespace earshot
