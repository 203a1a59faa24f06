#include "sim/acoustics/late_nodes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace earshot {
namespace {

// Any energy that a float can hold, down to the smallest, with any direction of it: nodes stay finite, and a node's direction is that of
// its energy wherever the energy has a finite reciprocal.
TEST(LateNodes, TheSmallestEnergiesStayFinite) {
  constexpr int bins = 40;
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
      LateNodes nodes;
      nodes.make(energy, 16000.f, onset, 2560);
      for (const LateNode& node : nodes.band(0)) {
        ASSERT_TRUE(std::isfinite(node.density) && std::isfinite(node.d)) << value;
        for (const float m : node.m) ASSERT_TRUE(std::isfinite(m)) << value;
      }
      if (value < std::numeric_limits<float>::min()) continue;
      for (const float m : nodes.band(0)[20].m) EXPECT_NEAR(m, 1.f, 1e-5f) << value;  // bin 20: all of it from one side, along (1, 1, 1)
      EXPECT_NEAR(nodes.band(0)[20].d, 0.f, 1e-3f) << value;
    }
  }
}

}  // namespace
}  // namespace earshot
