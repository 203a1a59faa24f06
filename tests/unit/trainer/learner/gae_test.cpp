// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/gae.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace earshot {
namespace {

using Row = std::vector<double>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

torch::Tensor column(const Row& values) { return torch::tensor(values, torch::kFloat64).unsqueeze(1); }

struct Case {
  Row rewards, values, terminated, truncated, final_values;
  double next_value;
};

Row advantages_of(const Case& c, const GaeConfig& config) {
  const torch::Tensor a = gae(column(c.rewards), column(c.values), column(c.terminated), column(c.truncated), column(c.final_values),
                              torch::tensor({c.next_value}, torch::kFloat64), config);
  return {a.data_ptr<double>(), a.data_ptr<double>() + a.numel()};
}

// gamma = lambda = 1/2, so gamma lambda = 1/4; rewards 1, 2, 3; values 2, 4, 8; the value after the last row is 16.  All numbers are exact
// in binary.
constexpr GaeConfig kHalf{.gamma = 0.5, .lambda = 0.5};
const Row kRewards{1, 2, 3}, kValues{2, 4, 8}, kNo{0, 0, 0};

TEST(Gae, ThreeStepsOfOneEpisode) {
  // d2 = 3 + 16/2 - 8 = 3;  d1 = 2 + 8/2 - 4 = 2;  d0 = 1 + 4/2 - 2 = 1
  // A2 = 3;  A1 = 2 + 3/4 = 2.75;  A0 = 1 + 2.75/4 = 1.6875
  EXPECT_EQ(advantages_of({kRewards, kValues, kNo, kNo, {kNan, kNan, kNan}, 16}, kHalf), (Row{1.6875, 2.75, 3}));
}

TEST(Gae, TerminationHasNoFuture) {
  // d1 = 2 + 0 - 4 = -2, and the chain is cut behind it: A1 = -2;  A0 = 1 - 2/4 = 0.5;  A2 = 3 as before
  EXPECT_EQ(advantages_of({kRewards, kValues, {0, 1, 0}, kNo, {kNan, kNan, kNan}, 16}, kHalf), (Row{0.5, -2, 3}));
}

TEST(Gae, TruncationBootstrapsFromTheFinalObservation) {
  // d1 = 2 + 6/2 - 4 = 1: the value 6 of the final observation, not 8 of the next episode's first.  A1 = 1;  A0 = 1 + 1/4;  A2 = 3
  EXPECT_EQ(advantages_of({kRewards, kValues, kNo, {0, 1, 0}, {kNan, 6, kNan}, 16}, kHalf), (Row{1.25, 1, 3}));
}

TEST(Gae, TerminationWinsOverTruncation) {
  EXPECT_EQ(advantages_of({kRewards, kValues, {0, 1, 0}, {0, 1, 0}, {kNan, 6, kNan}, 16}, kHalf), (Row{0.5, -2, 3}));
}

TEST(Gae, EndOnTheLastRow) {
  // Terminated: d2 = 3 - 8 = -5, whatever comes next;  A1 = 2 - 5/4 = 0.75;  A0 = 1 + 0.75/4 = 1.1875
  EXPECT_EQ(advantages_of({kRewards, kValues, {0, 0, 1}, kNo, {kNan, kNan, kNan}, kNan}, kHalf), (Row{1.1875, 0.75, -5}));
  // Truncated with final value 10: d2 = 3 + 10/2 - 8 = 0;  A1 = 2;  A0 = 1 + 2/4 = 1.5
  EXPECT_EQ(advantages_of({kRewards, kValues, kNo, {0, 0, 1}, {kNan, kNan, 10}, kNan}, kHalf), (Row{1.5, 2, 0}));
}

TEST(Gae, OneStep) {
  EXPECT_EQ(advantages_of({{1}, {2}, {0}, {0}, {kNan}, 16}, kHalf), (Row{7}));     // 1 + 16/2 - 2
  EXPECT_EQ(advantages_of({{1}, {2}, {1}, {0}, {kNan}, kNan}, kHalf), (Row{-1}));  // 1 - 2
  EXPECT_EQ(advantages_of({{1}, {2}, {0}, {1}, {6}, kNan}, kHalf), (Row{2}));      // 1 + 6/2 - 2
}

TEST(Gae, EnvsDoNotMix) {
  const auto two = [](const Row& a, const Row& b) {
    return torch::stack({torch::tensor(a, torch::kFloat64), torch::tensor(b, torch::kFloat64)}, 1);
  };
  const torch::Tensor a = gae(two(kRewards, kRewards), two(kValues, kValues), two({0, 1, 0}, kNo), two(kNo, {0, 1, 0}), two(kNo, {0, 6, 0}),
                              torch::tensor({16.0, 16.0}, torch::kFloat64), kHalf);
  EXPECT_TRUE(a.equal(two({0.5, -2, 3}, {1.25, 1, 3})));
}

/// Eq. 16 of the paper as it stands: the sum over all later deltas of the same episode.
std::vector<Row> brute_force(const std::vector<Case>& envs, const GaeConfig& config) {
  std::vector<Row> all;
  for (const Case& c : envs) {
    const std::size_t T = c.rewards.size();
    Row advantages(T);
    for (std::size_t t = 0; t < T; ++t)
      for (std::size_t k = t; k < T; ++k) {
        double future = k + 1 < T ? c.values[k + 1] : c.next_value;
        if (c.truncated[k] > 0) future = c.final_values[k];
        if (c.terminated[k] > 0) future = 0;
        advantages[t] +=
            std::pow(config.gamma * config.lambda, static_cast<double>(k - t)) * (c.rewards[k] + config.gamma * future - c.values[k]);
        if (c.terminated[k] > 0 || c.truncated[k] > 0) break;
      }
    all.push_back(advantages);
  }
  return all;
}

TEST(Gae, EqualsTheSumOverDeltasForRandomFlags) {
  torch::manual_seed(1);
  const GaeConfig config{.gamma = 0.99, .lambda = 0.95};
  for (int trial = 0; trial < 200; ++trial) {
    const std::int64_t T = 1 + trial % 12, B = 1 + trial % 5;
    const auto normal = [&](double scale) { return torch::randn({T, B}, torch::kFloat64) * scale; };
    const auto flags = [&] { return (torch::rand({T, B}) < 0.25).to(torch::kFloat64); };
    const torch::Tensor rewards = normal(1), values = normal(3), terminated = flags(), truncated = flags(), final_values = normal(3);
    const torch::Tensor next = torch::randn({B}, torch::kFloat64) * 3;
    std::vector<Case> envs;
    for (std::int64_t b = 0; b < B; ++b) {
      const auto row = [&](const torch::Tensor& slab) {
        const torch::Tensor env_rewards = slab.select(1, b).contiguous();
        return Row(env_rewards.data_ptr<double>(), env_rewards.data_ptr<double>() + T);
      };
      envs.push_back({row(rewards), row(values), row(terminated), row(truncated), row(final_values), next[b].item<double>()});
    }
    const std::vector<Row> expected = brute_force(envs, config);
    const torch::Tensor exact = gae(rewards, values, terminated, truncated, final_values, next, config);
    const auto f = [](const torch::Tensor& tensor) { return tensor.to(torch::kFloat32); };
    const torch::Tensor rounded = gae(f(rewards), f(values), f(terminated), f(truncated), f(final_values), f(next), config);
    ASSERT_EQ(rounded.scalar_type(), torch::kFloat32);
    for (std::int64_t b = 0; b < B; ++b)
      for (std::int64_t t = 0; t < T; ++t) {
        const double wanted = expected[static_cast<std::size_t>(b)][static_cast<std::size_t>(t)];
        EXPECT_NEAR(exact[t][b].item<double>(), wanted, 1e-12);   // sums of 12 numbers around 10
        EXPECT_NEAR(rounded[t][b].item<double>(), wanted, 1e-5);  // inputs around 10 rounded to float32
      }
  }
}

}  // namespace
}  // namespace earshot
