// SPDX-License-Identifier: Apache-2.0
#include "policy/action_distribution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

std::int32_t sample_one(const torch::Tensor& logits, ActingEnv acting_env, std::uint64_t seed) {
  std::int32_t action = -1;
  sample_actions(logits, std::span(&acting_env, 1), seed, std::span(&action, 1));
  return action;
}

TEST(ActionDistribution, LogProbabilitiesByHand) {
  // Weights 1, 2, 3, 4 of 10.
  const torch::Tensor logits = torch::tensor({1.0, 2.0, 3.0, 4.0}).log().expand({4, 4}) + 100;
  const torch::Tensor log_p = log_probabilities(logits, torch::arange(4));
  for (int a = 0; a < 4; ++a) EXPECT_NEAR(std::exp(log_p[a].item<double>()), 0.1 * (a + 1), 1e-5);  // logits of 104 hold 1e-5
}

TEST(ActionDistribution, EntropyByHand) {
  EXPECT_NEAR(entropy(torch::zeros({1, 4}))[0].item<double>(), std::log(4.0), 1e-6);
  // Probabilities 1/2, 1/4, 1/4, 0: 1/2 log 2 + 1/4 log 4 + 1/4 log 4 = 1.5 log 2; the last action is masked by -infinity.
  torch::Tensor logits = torch::tensor({std::log(2.f), 0.f, 0.f, -kInfinity}).unsqueeze(0).requires_grad_(true);
  const torch::Tensor h = entropy(logits);
  EXPECT_NEAR(h[0].item<double>(), 1.5 * std::log(2.0), 1e-6);
  h.sum().backward();
  // dH/dlogit_i = -p_i (log p_i + H): -1/2 (-log 2 + 1.5 log 2) = -log 2 / 4; -1/4 (-2 log 2 + 1.5 log 2) = log 2 / 8; 0 for p = 0.
  const std::array<double, 4> expected{-0.25 * std::log(2.0), 0.125 * std::log(2.0), 0.125 * std::log(2.0), 0};
  for (int a = 0; a < 4; ++a) EXPECT_NEAR(logits.grad()[0][a].item<double>(), expected[static_cast<std::size_t>(a)], 1e-6);
}

TEST(ActionDistribution, FrequenciesFollowTheProbabilities) {
  const std::array<double, 4> probability{0.1, 0.2, 0.3, 0.4};
  const torch::Tensor logits = torch::tensor({1.0, 2.0, 3.0, 4.0}).log().unsqueeze(0);
  std::array<double, 4> count{};
  constexpr int draws = 100000;
  for (std::uint32_t i = 0; i < draws; ++i)
    ++count[static_cast<std::size_t>(sample_one(logits, {.env = i % 7, .episode = i / 500, .step = i % 500}, 11))];
  double chi_square = 0;
  for (std::size_t a = 0; a < 4; ++a) chi_square += std::pow(count[a] - draws * probability[a], 2) / (draws * probability[a]);
  EXPECT_LT(chi_square, 16.27);  // three degrees of freedom: exceeded by chance once in a thousand seeds; ours is fixed
  // An error of 1 % of the mass (0.09, 0.21) would give 100000 (0.01^2 / 0.1 + 0.01^2 / 0.2) = 150.
}

// The first number of this stream is 0, the least that there is: the first action that is possible at all, not the first one.
TEST(ActionDistribution, AnActionOfProbabilityZeroIsNeverDrawn) {
  constexpr ActingEnv kWho{.env = 0, .episode = 0, .step = 16481244};
  ASSERT_EQ(RandomStream(1, Purpose::action, kWho.env, kWho.episode, kWho.step).uniform(0), 0.f);
  EXPECT_EQ(sample_one(torch::tensor({{-1e5f, 0.f, 0.f, 0.f}}), kWho, 1), 1);
  EXPECT_EQ(sample_one(torch::tensor({{-1e5f, -1e5f, -1e5f, 0.f}}), kWho, 1), 3);
  EXPECT_EQ(sample_one(torch::tensor({{0.f, 0.f, 0.f, 0.f}}), kWho, 1), 0);
}

TEST(ActionDistribution, WhoActsDecidesAndNotTheBatch) {
  torch::manual_seed(1);
  const torch::Tensor logits = torch::randn({6, 4});
  std::vector<ActingEnv> acting_envs;
  for (std::uint32_t i = 0; i < 6; ++i) acting_envs.push_back({.env = 10 + i, .episode = i % 2, .step = 3 * i});
  std::vector<std::int32_t> together(6), swapped(6);
  sample_actions(logits, acting_envs, 3, together);
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_EQ(sample_one(logits.slice(0, static_cast<std::int64_t>(i), static_cast<std::int64_t>(i) + 1), acting_envs[i], 3), together[i]);
  std::vector<ActingEnv> reversed(acting_envs.rbegin(), acting_envs.rend());
  sample_actions(logits.flip(0), reversed, 3, swapped);
  EXPECT_TRUE(std::equal(swapped.rbegin(), swapped.rend(), together.begin()));
}

TEST(ActionDistribution, EveryPartOfTheKeyCounts) {
  const torch::Tensor logits = torch::zeros({1, 4});
  int differ_env = 0, differ_episode = 0, differ_step = 0, differ_seed = 0;
  constexpr int trials = 400;
  for (std::uint32_t i = 0; i < trials; ++i) {
    const std::int32_t base = sample_one(logits, {i, 5, 6}, 1);
    differ_env += sample_one(logits, {i + 1000, 5, 6}, 1) != base;
    differ_episode += sample_one(logits, {i, 6, 6}, 1) != base;
    differ_step += sample_one(logits, {i, 5, 7}, 1) != base;
    differ_seed += sample_one(logits, {i, 5, 6}, 2) != base;
  }
  // Independent uniform actions differ with probability 3/4: 300 +- 8.7; five sigma.
  for (const int differ : {differ_env, differ_episode, differ_step, differ_seed}) EXPECT_NEAR(differ, 300, 44);
}

TEST(ActionDistribution, ImpossibleActionsAreNeverTaken) {
  const torch::Tensor logits = torch::tensor({-1e9f, 0.f, -1e9f, 0.f}).unsqueeze(0);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    const std::int32_t action = sample_one(logits, {i, 0, 0}, 4);
    EXPECT_TRUE(action == 1 || action == 3);
  }
}

TEST(ActionDistribution, GreedyTakesTheLowestOfEquals) {
  const torch::Tensor logits = torch::tensor({{0.f, 2.f, 2.f, 1.f}, {3.f, 3.f, 3.f, 3.f}, {0.f, 0.f, 0.f, 1.f}});
  std::vector<std::int32_t> actions(3);
  greedy_actions(logits, actions);
  EXPECT_EQ(actions, (std::vector<std::int32_t>{1, 0, 3}));
}

TEST(ActionDistribution, RefusesLogitsThatAreNotFinite) {
  for (const float bad : {kInfinity, -kInfinity, std::nanf("")}) {
    torch::Tensor logits = torch::zeros({2, 4});
    logits[1][2] = bad;
    const std::vector<ActingEnv> acting_envs{{.env = 40, .episode = 1, .step = 2}, {.env = 41, .episode = 3, .step = 4}};
    std::vector<std::int32_t> actions(2);
    EXPECT_THROW(greedy_actions(logits, actions), RunError);
    try {
      sample_actions(logits, acting_envs, 1, actions);
      FAIL() << "no exception";
    } catch (const RunError& error) {
      EXPECT_NE(std::string(error.what()).find("env 41"), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace earshot
