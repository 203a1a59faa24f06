// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/paired_comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

// Binomials in whole numbers: twice the tail over 2^n, exact in 64 bits up to n = 60.  The function works in doubles with lgamma, whose
// error is some units in the last place of log n!, here 200: 1e-12 of the value; ten thousand fold over that would be a wrong term.
TEST(SignTest, IsTheExactBinomialTail) {
  for (std::uint64_t n = 1; n <= 60; ++n) {
    std::uint64_t choose = 1, tail = 0;
    for (std::uint64_t fewer = 0; 2 * fewer < n; ++fewer) {
      tail += choose;
      const double exact = std::min(1.0, 2 * static_cast<double>(tail) / std::exp2(static_cast<double>(n)));
      EXPECT_NEAR(sign_test_p_value(fewer, n - fewer), exact, 1e-9 * exact) << fewer << " of " << n;
      EXPECT_EQ(sign_test_p_value(n - fewer, fewer), sign_test_p_value(fewer, n - fewer));
      if (fewer < 30) choose = choose * (n - fewer) / (fewer + 1);
    }
  }
  EXPECT_EQ(sign_test_p_value(0, 0), 1);
  EXPECT_EQ(sign_test_p_value(7, 7), 1);
  EXPECT_DOUBLE_EQ(sign_test_p_value(0, 5), 0.0625);
  // Where the normal distribution says the same: z = 10 of 1,000,000 throws, continuity corrected; 2 (1 - Phi(9.999)) = 1.539e-23.
  EXPECT_NEAR(sign_test_p_value(495000, 505000) / 1.54e-23, 1, 0.02);
}

EvaluationResult result_of(const std::string& name, const std::vector<double>& spl, int per_house) {
  EvaluationResult result;
  result.agent = name;
  result.set_hash = "set";
  for (std::size_t i = 0; i < spl.size(); ++i) {
    EpisodeMetrics metrics;
    metrics.spl = spl[i];
    metrics.success = spl[i] > 0 ? 1 : 0;
    result.episodes.push_back({std::to_string(i), "house:" + std::to_string(static_cast<int>(i) / per_house), metrics, {0}});
  }
  return result;
}

// Worked by hand: differences of success 1, 0, 0, -1, 1, 1, 0, 0, 1, 1: mean 0.4; five better, one worse, four equal; p = 2 * 7 / 64.
TEST(PairedComparison, CountsAndMeans) {
  const EvaluationResult a = result_of("a", {1, 1, 0, 0, 1, 1, 0, 1, 1, 1}, 2);
  const EvaluationResult b = result_of("b", {0, 1, 0, 1, 0, 0, 0, 1, 0, 0}, 2);
  const PairedComparison compared = compare_paired(a, b);
  EXPECT_DOUBLE_EQ(compared.success.difference.mean, 0.4);
  EXPECT_EQ(compared.success.wins, 5u);
  EXPECT_EQ(compared.success.losses, 1u);
  EXPECT_EQ(compared.success.ties, 4u);
  EXPECT_NEAR(compared.success.p_value, 14.0 / 64, 1e-12);
  EXPECT_LE(compared.success.difference.low, 0.4);
  EXPECT_GE(compared.success.difference.high, 0.4);
  EXPECT_THAT(comparison_text(a, b), testing::HasSubstr("a less b, 10 episodes"));
}

// Agents that differ by the same in every episode, however hard: no spread is left in the pairs, where the agents alone have much.
TEST(PairedComparison, PairsAreSharperThanAgentsAlone) {
  std::vector<double> hard, easier;
  for (int i = 0; i < 40; ++i) {
    hard.push_back(0.1 + 0.02 * i);
    easier.push_back(hard.back() + 0.05);
  }
  const EvaluationResult a = result_of("a", easier, 5), b = result_of("b", hard, 5);
  const PairedMetric spl = compare_paired(a, b).spl;
  EXPECT_NEAR(spl.difference.low, 0.05, 1e-12);
  EXPECT_NEAR(spl.difference.high, 0.05, 1e-12);
  EXPECT_LT(a.spl().low, b.spl().high);
  EXPECT_LT(spl.p_value, 1e-9);
}

TEST(PairedComparison, OtherEpisodesAreRefused) {
  const EvaluationResult a = result_of("a", {1, 0, 1}, 1);
  EvaluationResult b = result_of("b", {1, 0, 1}, 1);
  b.set_hash = "another";
  EXPECT_THROW(compare_paired(a, b), InputError);
  b = result_of("b", {1, 0}, 1);
  EXPECT_THROW(compare_paired(a, b), InputError);
  b = result_of("b", {1, 0, 1}, 1);
  std::swap(b.episodes[0], b.episodes[2]);
  EXPECT_THROW(compare_paired(a, b), InputError);
}

}  // namespace
}  // namespace earshot
