// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <glm/geometric.hpp>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

/// Mean product of channels a and b over the late part, by many sources, over the mean power of W.
struct Moments {
  std::vector<double> with_w, power;
};
Moments late_moments(int order, const EnergyHistogram& late) {
  static const auto tables =
      make_synthesis_tables(config_at(16000.f, 0.5f), BandLayout::octaves(16000.f), ListenerLayout::ambisonics(order), nullptr);
  RirSynthesizer synthesizer(tables);
  EnergyResponse response = response_with();
  response.late = late;
  const auto count = static_cast<std::size_t>((order + 1) * (order + 1));
  Moments moments{std::vector<double>(count), std::vector<double>(count)};
  for (std::uint64_t key = 0; key < 12; ++key) {
    const Rir rir = rendered(synthesizer, response, 0, key);
    for (std::size_t c = 0; c < count; ++c) {
      const auto w = rir.channel(0), x = rir.channel(static_cast<int>(c));
      for (std::size_t n = 0; n < w.size(); ++n) {
        moments.with_w[c] += static_cast<double>(w[n]) * static_cast<double>(x[n]);
        moments.power[c] += static_cast<double>(x[n]) * static_cast<double>(x[n]);
      }
    }
  }
  for (std::size_t c = count; c-- > 0;) moments.with_w[c] /= moments.power[0], moments.power[c] /= c == 0 ? 1.0 : moments.power[0];
  return moments;
}

// 12 sources of 0.5 s at 8 kHz bandwidth and T = 2 s: about 4000 independent samples each, 0.5 % rms of a product of independent channels.
TEST(AmbisonicSynthesis, DiffuseFieldIsDiffuseInAllOrders) {
  const Moments moments = late_moments(3, decay_of(2.0, 0.02, 7));
  for (std::size_t c = 1; c < 16; ++c) {
    EXPECT_NEAR(moments.with_w[c], 0.0, 0.03) << c;
    EXPECT_NEAR(moments.power[c], 1.0, 0.05) << c;
  }
}

TEST(AmbisonicSynthesis, LateFieldHasTheMomentsOfTheHistogram) {
  const glm::vec3 from = glm::normalize(glm::vec3(0.5f, 0.3f, -0.7f));
  std::array<float, 16> harmonics{};
  spherical_harmonics_n3d(from, 3, harmonics);
  const double directional = 0.8;
  const Moments moments = late_moments(3, decay_of(2.0, 0.02, 7, 0.004f, 0.5, 2, from, static_cast<float>(directional)));
  for (std::size_t c = 1; c < 16; ++c)  // order 3 is not in the histogram: diffuse
    EXPECT_NEAR(moments.with_w[c], c < 9 ? directional * static_cast<double>(harmonics[c]) : 0.0, 0.04) << c;
  for (std::size_t l = 1; l <= 3; ++l) {
    double power = 0;
    for (std::size_t c = l * l; c < (l + 1) * (l + 1); ++c) power += moments.power[c];
    EXPECT_NEAR(power / static_cast<double>(2 * l + 1), 1.0, 0.03) << l;  // a field of any direction has 2 l + 1 in each order
  }
}

TEST(AmbisonicSynthesis, OrderNineIsRendered) {
  const ListenerLayout layout = ListenerLayout::ambisonics(9, HarmonicNorm::n3d, HarmonicAxes::ego);
  RirSynthesizer nine(make_synthesis_tables(config_at(16000.f, 0.02f), BandLayout::octaves(16000.f), layout, nullptr));
  const Rir rir = rendered(nine, response_with({arrival_at(3.43, 0.5, glm::normalize(glm::vec3(1, 2, 3)))}), 1.0);
  ASSERT_EQ(rir.num_channels, 100);
  double sum = 0;
  for (int c = 0; c < 100; ++c) sum += energy_of(rir.channel(c));
  EXPECT_NEAR(sum / energy_of(rir.channel(0)), 100.0, 1e-3);
}

}  // namespace
}  // namespace earshot
