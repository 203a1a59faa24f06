// SPDX-License-Identifier: Apache-2.0
#include "sim/base/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace earshot {
namespace {

using Words = std::array<std::uint32_t, 4>;

// Known answers published with Random123 (kat_vectors, philox4x32 10).
TEST(Philox, KnownAnswers) {
  EXPECT_EQ(philox4x32({0, 0, 0, 0}, {0, 0}), (Words{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Words{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Words{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

TEST(RandomStream, IsAFunctionOfItsKeys) {
  const RandomStream stream(7, Purpose::test, 1, 2, 3);
  EXPECT_EQ(stream.bits4(5), RandomStream(7, Purpose::test, 1, 2, 3).bits4(5));
  EXPECT_NE(stream.bits4(5), RandomStream(8, Purpose::test, 1, 2, 3).bits4(5));
  EXPECT_NE(stream.bits4(5), RandomStream(7, Purpose::scatter, 1, 2, 3).bits4(5));
  EXPECT_NE(stream.bits4(5), RandomStream(7, Purpose::test, 2, 1, 3).bits4(5));
  EXPECT_NE(stream.bits4(5), stream.bits4(6));
  EXPECT_NE(RandomStream(0, Purpose::test).bits4(0), RandomStream(~std::uint64_t{0}, Purpose::test).bits4(0));
}

// Mean and variance of n uniform numbers: 1/2 +- 1/sqrt(12 n) and 1/12 +- 1/sqrt(180 n); four standard errors, fixed seed.
TEST(RandomStream, UniformMoments) {
  const RandomStream stream(1, Purpose::test);
  constexpr int n = 100000;
  double sum = 0, square = 0;
  for (std::uint32_t i = 0; i < n; ++i) {
    const float u = stream.uniform(i);
    ASSERT_GE(u, 0.f);
    ASSERT_LT(u, 1.f);
    sum += u;
    square += (u - 0.5) * (u - 0.5);
  }
  EXPECT_NEAR(sum / n, 0.5, 4.0 / std::sqrt(12.0 * n));
  EXPECT_NEAR(square / n, 1.0 / 12.0, 4.0 / std::sqrt(180.0 * n));
}

// Standard normal: variance of the variance estimate is 2/n, of the fourth moment 96/n.
TEST(RandomStream, NormalMoments) {
  const RandomStream stream(2, Purpose::test);
  constexpr int n = 100000;
  double sum = 0, square = 0, fourth = 0, cross = 0;
  for (std::uint32_t i = 0; i < n / 2; ++i) {
    const auto pair = stream.normal2(i);
    for (const double x : pair) {
      sum += x;
      square += x * x;
      fourth += x * x * x * x;
    }
    cross += static_cast<double>(pair[0]) * pair[1];
  }
  EXPECT_NEAR(sum / n, 0.0, 4.0 / std::sqrt(n));
  EXPECT_NEAR(square / n, 1.0, 4.0 * std::sqrt(2.0 / n));
  EXPECT_NEAR(fourth / n, 3.0, 4.0 * std::sqrt(96.0 / n));
  EXPECT_NEAR(cross / (n / 2), 0.0, 4.0 / std::sqrt(n / 2));
}

TEST(RandomStream, BelowIsEvenAndInRange) {
  const RandomStream stream(3, Purpose::test);
  std::vector<int> counts(7, 0);
  constexpr int n = 70000;
  for (std::uint32_t i = 0; i < n; ++i) ++counts.at(stream.below(7, i));
  double chi_square = 0;
  for (const int count : counts) chi_square += (count - n / 7.0) * (count - n / 7.0) / (n / 7.0);
  EXPECT_LT(chi_square, 22.5);  // 99.9 % point for 6 degrees of freedom
  EXPECT_EQ(stream.below(1, 0), 0u);
}

}  // namespace
}  // namespace earshot
