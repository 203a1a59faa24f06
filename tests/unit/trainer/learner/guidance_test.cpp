// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <thread>
#include <vector>

#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "sim/base/errors.h"
#include "tests/support/largest.h"
#include "tests/support/workers/two_workers.h"
#include "trainer/learner/guidance_config.h"
#include "trainer/learner/guidance_loss.h"
#include "trainer/learner/ppo.h"
#include "trainer/learner/value_scale.h"

namespace earshot {
namespace {

constexpr int kGuidedHidden = 8;
const std::unique_ptr<Collective> kGuidedWorker = make_single_worker();
Collective& kGuidedAlone = *kGuidedWorker;

TEST(GuidanceConfig, WeightsFallLinearly) {
  const GuidanceConfig config{
      .imitation = 2, .imitation_end_weight = 0.5, .imitation_until = 0.5, .oracle = 0.8, .oracle_until = 0.25, .goal = 0};
  EXPECT_DOUBLE_EQ(config.imitation_at(0), 2);
  EXPECT_DOUBLE_EQ(config.imitation_at(0.25), 1.25);
  EXPECT_DOUBLE_EQ(config.imitation_at(0.5), 0.5);
  EXPECT_DOUBLE_EQ(config.imitation_at(1), 0.5);
  EXPECT_DOUBLE_EQ(config.oracle_at(0.125), 0.4);
  EXPECT_DOUBLE_EQ(config.oracle_at(0.25), 0);
  EXPECT_THROW(validate(GuidanceConfig{.oracle = 0.5}), InputError);  // without imitation nothing is learnt from it
  EXPECT_THROW(validate(GuidanceConfig{.imitation = -1}), InputError);
  EXPECT_THROW(validate(GuidanceConfig{.imitation = 1, .imitation_until = 0.1, .oracle = 1, .oracle_until = 0.5}), InputError);
  EXPECT_THROW(validate(GuidanceConfig{.imitation = 1, .oracle = 1.5}), InputError);
}

TEST(ImitationLoss, IsTheCrossEntropyOfTheRowsThatCount) {
  torch::Tensor logits = torch::tensor({{1.f, 2.f, 0.f, -1.f}, {5.f, 5.f, 5.f, 5.f}, {NAN, 0.f, 0.f, 0.f}}).requires_grad_();
  const torch::Tensor oracle = torch::tensor({{1}, {3}, {0}}, torch::kInt32), valid = torch::tensor({1.f, 1.f, 0.f});
  const torch::Tensor loss = imitation_loss(logits, oracle, valid);
  const double first = std::log(std::exp(1.0) + std::exp(2.0) + 1 + std::exp(-1.0)) - 2, second = std::log(4.0);
  EXPECT_NEAR(loss.item<double>(), (first + second) / 2, 1e-6);
  loss.backward();
  EXPECT_EQ(largest(logits.grad()[2]), 0);
  // Of the softmax: (p - 1) / rows at the oracle's action.
  EXPECT_NEAR(logits.grad()[1][3].item<double>(), (0.25 - 1) / 2, 1e-6);
  EXPECT_EQ(imitation_loss(logits.detach().slice(0, 0, 2), oracle.slice(0, 0, 2), torch::zeros({2})).item<double>(), 0);
}

TEST(GoalLoss, IsZeroForTheTruthAndCountsEachPart) {
  const double bearing = 0.7, corner = -2.0, metres = 3.5;
  const torch::Tensor state = torch::tensor({{metres, 3.0, bearing, corner}}, torch::kFloat32);
  const auto said = [&](double turn, double farther, double near_logit) {
    return torch::tensor({{std::cos(bearing + turn), std::sin(bearing + turn), std::cos(corner), std::sin(corner),
                           std::log1p(metres) + farther, near_logit}},
                         torch::kFloat32);
  };
  const torch::Tensor valid = torch::ones({1});
  EXPECT_NEAR(goal_loss(said(0, 0, -40), state, 1.0, valid).item<double>(), 0, 1e-6);
  EXPECT_NEAR(goal_loss(said(0, 0.5, -40), state, 1.0, valid).item<double>(), 0.25, 1e-5);
  EXPECT_NEAR(goal_loss(said(std::numbers::pi, 0, -40), state, 1.0, valid).item<double>(), 4, 1e-5);  // the opposite of a unit vector
  EXPECT_NEAR(goal_loss(said(0, 0, 0), state, 1.0, valid).item<double>(), std::log(2.0), 1e-6);
  EXPECT_NEAR(goal_loss(said(0, 0, -40), state, 4.0, valid).item<double>(), 40, 1e-4);  // it is near, and that was denied
}

ObservationSpec guided_spec() {
  ObservationSpec spec;
  spec.depth = spec.spectrogram = false;
  spec.pointgoal = spec.oracle_action = spec.goal_state = true;
  return spec;
}

PolicyConfig guided_config() {
  PolicyConfig config;
  config.hidden_size = kGuidedHidden;
  config.guided_critic = config.goal_heads = config.normalize_values = true;
  config.seed = 3;
  return config;
}

ObservationTensors observations(std::int64_t rows) {
  return {{"pointgoal", torch::randn({rows, 2})},
          {"oracle_action", torch::randint(4, {rows, 1}, torch::kInt32)},
          {"goal_state", torch::cat({torch::rand({rows, 2}) * 5, torch::randn({rows, 2})}, 1)}};
}

TEST(GuidedPolicy, ActsWithoutWhatIsPrivileged) {
  torch::manual_seed(1);
  ActorCritic policy(guided_spec(), guided_config());
  const ObservationTensors seen = observations(5);
  const torch::Tensor hidden = torch::randn({5, kGuidedHidden}), not_done = torch::ones({5});
  const PolicyOutput trained = policy->step(seen, hidden, not_done);
  const PolicyOutput evaluated = policy->step({{"pointgoal", seen["pointgoal"]}}, hidden, not_done);
  EXPECT_TRUE(trained.logits.equal(evaluated.logits));
  EXPECT_TRUE(trained.goal.equal(evaluated.goal));
  EXPECT_EQ(largest(evaluated.value), 0);
  ObservationTensors elsewhere = seen;
  elsewhere.at("goal_state") = seen["goal_state"] + 1;
  EXPECT_GT(largest(policy->step(elsewhere, hidden, not_done).value - trained.value), 1e-4);
  EXPECT_TRUE(policy->step(elsewhere, hidden, not_done).logits.equal(trained.logits));
  // A policy that is made without the privileged sensors has the same architecture: checkpoints fit.
  ObservationSpec spec = guided_spec();
  spec.oracle_action = spec.goal_state = false;
  EXPECT_EQ(ActorCritic(spec, guided_config())->architecture(), policy->architecture());
}

TEST(GuidedPolicy, ValuesStayWhenTheirUnitChanges) {
  torch::manual_seed(2);
  ActorCritic policy(guided_spec(), guided_config());
  const ObservationTensors seen = observations(5);
  const torch::Tensor hidden = torch::randn({5, kGuidedHidden}), not_done = torch::ones({5});
  const torch::Tensor before = policy->step(seen, hidden, not_done).value;
  ASSERT_GT(largest(before), 1e-3);
  policy->set_value_scale(3.0, 4.0);
  EXPECT_LT(largest(policy->step(seen, hidden, not_done).value - before), 1e-5);  // float32, numbers around 3
  policy->set_value_scale(-20.0, 0.5);
  EXPECT_LT(largest(policy->step(seen, hidden, not_done).value - before), 1e-4);  // around 20
}

TEST(ValueScale, FollowsTheReturnsOfAllWorkers) {
  const std::array<torch::Tensor, 2> returns{torch::tensor({{1.f, 3.f}, {NAN, 5.f}}), torch::tensor({{7.f, 100.f}})};
  const std::array<torch::Tensor, 2> valid{torch::tensor({{true, true}, {true, true}}), torch::tensor({{true, false}})};
  std::array<ActorCritic, 2> policies{ActorCritic(guided_spec(), guided_config()), ActorCritic(guided_spec(), guided_config())};
  TwoWorkers workers;
  std::vector<std::thread> threads;
  for (int rank = 0; rank < 2; ++rank)
    threads.emplace_back([&, rank] {
      const auto r = static_cast<std::size_t>(rank);
      TwoWorkers::Worker worker = workers.worker(rank);
      follow_returns(policies[r], returns[r], valid[r], 0, worker);
      follow_returns(policies[r], returns[r] + 10, valid[r], 1, worker);
    });
  for (std::thread& thread : threads) thread.join();
  // 1, 3, 5, 7 have mean 4 and variance 5; a tenth of the way to 14 afterwards, with squares of 21 and 201.
  for (const ActorCritic& policy : policies) {
    EXPECT_NEAR(policy->value_mean(), 5, 1e-5);
    EXPECT_NEAR(policy->value_deviation(), std::sqrt(0.9 * 21 + 0.1 * 201 - 25), 1e-5);
  }
}

/// Two envs; in the first one the oracle acts.
RolloutBuffer half_guided(ActorCritic policy, int num_steps) {
  const torch::NoGradGuard no_gradient;
  torch::manual_seed(5);
  RolloutBuffer rollout(guided_spec(), num_steps, 2, kGuidedHidden);
  torch::Tensor hidden = torch::zeros({2, kGuidedHidden});
  rollout.begin(hidden);
  for (int t = 0; t < num_steps; ++t) {
    const ObservationTensors seen = observations(2);
    const PolicyOutput output = policy->step(seen, hidden, torch::ones({2}));
    const torch::Tensor actions = torch::stack({seen["oracle_action"][0][0].to(torch::kInt64), torch::randint(4, {}, torch::kInt64)});
    rollout.push(seen, torch::ones({2}), actions, log_probabilities(output.logits, actions), output.value, torch::tensor({1.f, 0.f}));
    const std::vector<float> rewards{torch::randn({}).item<float>(), torch::randn({}).item<float>()};
    const std::vector<std::uint8_t> no_flags{0, 0}, all_flags{1, 1};
    rollout.push_outcome(rewards, no_flags, no_flags, torch::zeros({2}), all_flags);
    hidden = output.hidden;
  }
  rollout.finish(torch::zeros({2}));
  return rollout;
}

torch::Tensor weights_after(const RolloutBuffer& rollout, const GuidanceConfig& guidance, UpdateStats* stats = nullptr) {
  ActorCritic policy(guided_spec(), guided_config());
  PpoConfig config;
  config.epochs = config.minibatches = 1;
  const UpdateStats update = PpoLearner(policy, config, 1, guidance).update(rollout, 0, 0, kGuidedAlone);
  if (stats) *stats = update;
  std::vector<torch::Tensor> parts;
  for (const torch::Tensor& parameter : policy->parameters()) parts.push_back(parameter.detach().flatten());
  return torch::cat(parts);
}

TEST(GuidedLearner, StepsOfTheOracleTeachByImitationAlone) {
  const RolloutBuffer rollout = half_guided(ActorCritic(guided_spec(), guided_config()), 6);
  RolloutBuffer other_rewards = rollout;
  other_rewards.rewards = rollout.rewards.clone();
  other_rewards.rewards.select(1, 0).add_(5);  // of the env that the oracle leads
  const torch::Tensor by_ppo = weights_after(rollout, {});
  EXPECT_TRUE(weights_after(other_rewards, {}).equal(by_ppo));
  other_rewards.rewards.select(1, 1).add_(5);  // of the other one
  EXPECT_FALSE(weights_after(other_rewards, {}).equal(by_ppo));

  RolloutBuffer other_labels = rollout;
  other_labels.observations.at("oracle_action") = (rollout.observations["oracle_action"] + 1).remainder(4);
  EXPECT_TRUE(weights_after(other_labels, {}).equal(by_ppo));
  const GuidanceConfig imitation{.imitation = 1};
  UpdateStats stats;
  EXPECT_FALSE(weights_after(other_labels, imitation).equal(weights_after(rollout, imitation, &stats)));
  EXPECT_NEAR(stats.imitation_loss, std::log(4.0), 0.1);  // all actions are about equally likely at first
  EXPECT_LT(stats.max_ratio_error, 1e-5);
}

TEST(GuidedLearner, ImitationLearnsTheOraclesActions) {
  ActorCritic policy(guided_spec(), guided_config());
  RolloutBuffer rollout = half_guided(policy, 32);
  // An oracle that can be read off the observation.
  rollout.observations.at("oracle_action") = rollout.observations["pointgoal"].select(2, 0).gt(0).to(torch::kInt32).unsqueeze(2) + 1;
  PpoConfig config;
  config.learning_rate = 1e-2;
  config.max_gradient_norm = 10;
  config.value_coefficient = 0;
  PpoLearner learner(policy, config, 1, {.imitation = 1, .imitation_end_weight = 1});
  UpdateStats stats;
  for (std::uint64_t update = 0; update < 60; ++update) stats = learner.update(rollout, 0, update, kGuidedAlone);
  EXPECT_GT(stats.oracle_agreement, 0.95);
  EXPECT_LT(stats.imitation_loss, 0.3);
}

TEST(PpoLearner, EpochsEndAtTheBudgetOfDivergence) {
  PpoConfig config;
  config.epochs = 8;
  config.minibatches = 1;
  config.learning_rate = 3e-2;
  const auto epochs = [&](double target_kl) {
    ActorCritic policy(guided_spec(), guided_config());
    config.target_kl = target_kl;
    return PpoLearner(policy, config, 1).update(half_guided(policy, 16), 0, 0, kGuidedAlone).epochs;
  };
  EXPECT_EQ(epochs(0), 8);
  EXPECT_EQ(epochs(1e9), 8);
  EXPECT_EQ(epochs(1e-9), 2);  // the first epoch still has the policy that acted
}

}  // namespace
}  // namespace earshot
