// SPDX-License-Identifier: Apache-2.0
// Rows of an earlier rollout in the learner: the table of docs/explanation/ppo.md, section 1.2, by hand, for our buffer and for the
// predecessor's.
#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "policy/action_distribution.h"
#include "tests/support/workers/pointgoal_policy.h"
#include "trainer/learner/ppo.h"

namespace earshot {
namespace {

constexpr int kSteps = 8, kStaleHidden = 4;

/// Every state is worth 0 to it, so that the value loss is half the mean square of the returns.
ActorCritic policy_without_values() {
  ActorCritic policy = pointgoal_policy(kStaleHidden);
  const torch::NoGradGuard no_gradient;
  policy->named_parameters()["critic.weight"].zero_();
  policy->named_parameters()["critic.bias"].zero_();
  return policy;
}

void push_row(RolloutBuffer& buffer, ActorCritic& policy, torch::Tensor& hidden, float seen, float reward) {
  const torch::NoGradGuard no_gradient;
  const ObservationTensors observation{{"pointgoal", torch::full({1, 2}, seen)}};
  const PolicyOutput output = policy->step(observation, hidden, torch::ones({1}));
  const torch::Tensor action = torch::zeros({1}, torch::kInt64);
  buffer.push(observation, torch::ones({1}), action, log_probabilities(output.logits, action), output.value);
  const std::uint8_t no = 0, yes = 1;
  buffer.push_outcome(std::span(&reward, 1), std::span(&no, 1), std::span(&no, 1), torch::zeros({1}), std::span(&yes, 1));
  hidden = output.hidden;
}

/// Value loss of the first minibatch of an update, all of the rollout, where returns are sums of rewards.
double value_loss_of(const RolloutBuffer& rollout) {
  PpoConfig config;
  config.epochs = config.minibatches = 1;
  config.gae = {.gamma = 1, .lambda = 1};
  const auto alone = make_single_worker();
  const UpdateStats stats = PpoLearner(policy_without_values(), config, 1).update(rollout, 0, 0, *alone);
  EXPECT_LT(stats.max_ratio_error, kMaxRatioError);
  return stats.value_loss;
}

/// The predecessor's storage: an index modulo T that no rollout sets back, and observations in T + 1 slots, the last of which bootstraps.
struct ModuloStorage {
  std::array<float, kSteps> rewards{};
  std::array<float, kSteps + 1> observations{};
  std::size_t next = 0;
  void push(float reward, float observation) {
    rewards[next] = reward;
    observations[next + 1] = observation;
    next = (next + 1) % kSteps;
  }
};

// The reward of a step is its time, and the bootstrap that of the last one.  Returns of 1..8, then 9..11, then 12..19, worked by hand.
TEST(StaleRows, TheLearnerReadsNone) {
  struct Rollout {
    int steps;
    std::vector<double> returns;
    double value_loss;
  };
  const std::vector<Rollout> table{{8, {44, 43, 41, 38, 34, 29, 23, 16}, 605.75},  // 9692 / 16
                                   {3, {41, 32, 22}, 531.5},                       // 3189 / 6
                                   {8, {143, 131, 118, 104, 89, 73, 56, 38}, 5011.25}};
  RolloutBuffer buffer(pointgoal_only(), kSteps, 1, kStaleHidden);
  int time = 0;
  for (const Rollout& rollout : table) {
    ActorCritic policy = policy_without_values();
    torch::Tensor hidden = torch::zeros({1, kStaleHidden});
    buffer.begin(hidden);
    for (int step = 0; step < rollout.steps; ++step, ++time)
      push_row(buffer, policy, hidden, static_cast<float>(time), static_cast<float>(time + 1));
    buffer.finish(torch::full({1}, static_cast<float>(time)));
    double squares = 0;
    for (const double value : rollout.returns) squares += value * value;
    ASSERT_DOUBLE_EQ(0.5 * squares / static_cast<double>(rollout.returns.size()), rollout.value_loss);
    EXPECT_NEAR(value_loss_of(buffer), rollout.value_loss, 1e-6 * rollout.value_loss) << "up to time " << time;
  }
}

// The same learner, given what the predecessor gave to its own, says other numbers: the test above would see a stale row.
TEST(StaleRows, ThePredecessorsTableGivesOtherLosses) {
  struct Rollout {
    int steps;
    std::vector<float> rewards;
    float bootstrap;
    double value_loss;
  };
  const std::vector<Rollout> table{{8, {1, 2, 3, 4, 5, 6, 7, 8}, 8, 605.75},  // the first one is right
                                   {3, {9, 10, 11, 4, 5, 6, 7, 8}, 8, 920.75},
                                   {8, {17, 18, 19, 12, 13, 14, 15, 16}, 16, 4098.75}};
  ModuloStorage storage;
  int time = 0;
  for (const Rollout& rollout : table) {
    for (int step = 0; step < rollout.steps; ++step, ++time) storage.push(static_cast<float>(time + 1), static_cast<float>(time + 1));
    ASSERT_EQ(std::vector<float>(storage.rewards.begin(), storage.rewards.end()), rollout.rewards);
    ASSERT_EQ(storage.observations.back(), rollout.bootstrap);
    RolloutBuffer buffer(pointgoal_only(), kSteps, 1, kStaleHidden);
    ActorCritic policy = policy_without_values();
    torch::Tensor hidden = torch::zeros({1, kStaleHidden});
    buffer.begin(hidden);
    for (std::size_t row = 0; row < kSteps; ++row) push_row(buffer, policy, hidden, storage.observations[row], storage.rewards[row]);
    buffer.finish(torch::full({1}, storage.observations.back()));
    EXPECT_NEAR(value_loss_of(buffer), rollout.value_loss, 1e-6 * rollout.value_loss) << "up to time " << time;
  }
}

}  // namespace
}  // namespace earshot
