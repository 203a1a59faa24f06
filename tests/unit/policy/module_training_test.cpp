// SPDX-License-Identifier: Apache-2.0
// A module learns as the built-in network does.
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "policy/action_distribution.h"
#include "tests/support/workers/script_modules.h"
#include "trainer/collective/collective.h"
#include "trainer/learner/ppo.h"

namespace earshot {
namespace {

constexpr int kLearningHidden = 8, kLearningSteps = 12, kLearningEnvs = 6;

/// What `policy` could have done: drawn observations, actions and rewards, with episodes that end on the way.
RolloutBuffer drawn_rollout_of(const PolicyNetwork& policy) {
  const torch::NoGradGuard no_gradient;
  torch::manual_seed(9);
  RolloutBuffer rollout(pointgoal_only(), kLearningSteps, kLearningEnvs, policy->hidden_size());
  torch::Tensor hidden = torch::zeros({kLearningEnvs, policy->hidden_size()}), not_done = torch::zeros({kLearningEnvs});
  rollout.begin(hidden);
  constexpr auto B = static_cast<std::size_t>(kLearningEnvs);
  for (int t = 0; t < kLearningSteps; ++t) {
    const ObservationTensors seen{{"pointgoal", torch::randn({kLearningEnvs, 2})}};
    const PolicyOutput output = policy->step(seen, hidden, not_done);
    const torch::Tensor actions = torch::randint(4, {kLearningEnvs}, torch::kInt64);
    rollout.push(seen, not_done, actions, log_probabilities(output.logits, actions), output.value);
    std::vector<float> rewards(B);
    std::vector<std::uint8_t> terminated(B), truncated(B, 0), valid(B, 1);
    const torch::Tensor reward = torch::randn({kLearningEnvs}), event = torch::rand({kLearningEnvs});
    for (std::size_t b = 0; b < B; ++b) {
      rewards[b] = reward[static_cast<std::int64_t>(b)].item<float>();
      terminated[b] = event[static_cast<std::int64_t>(b)].item<float>() < 0.2f;
    }
    rollout.push_outcome(rewards, terminated, truncated, torch::zeros({kLearningEnvs}), valid);
    hidden = output.hidden;
    not_done = (event >= 0.2).to(torch::kFloat32);
  }
  rollout.finish(torch::zeros({kLearningEnvs}));
  return rollout;
}

TEST(ModuleTraining, MovesTheWeightsAsTheBuiltInNetworkDoes) {
  PpoConfig config;
  config.learning_rate = 1e-3;
  config.minibatches = 2;
  config.epochs = 3;
  const std::unique_ptr<Collective> alone = make_single_worker();
  const ActorCritic built_in = pointgoal_policy(kLearningHidden);
  for (const std::string& source : {kGruSource, kGruSource + kGruSequence}) {
    const ActorCritic copy = pointgoal_policy(kLearningHidden);
    const PolicyNetwork module = std::make_shared<ModulePolicyImpl>(pointgoal_only(), PolicyConfig{}, file_like(copy, source), "net.pt");
    PpoLearner of_built_in(copy, config, 5), of_module(module, config, 5);
    for (std::uint64_t update = 0; update < 3; ++update) {
      const UpdateStats one = of_built_in.update(drawn_rollout_of(copy), 0, update, *alone);
      const UpdateStats other = of_module.update(drawn_rollout_of(module), 0, update, *alone);
      EXPECT_EQ(other.taken_steps, 6);
      EXPECT_LT(other.max_ratio_error, 1e-5);
      EXPECT_NEAR(other.policy_loss, one.policy_loss, 1e-5);
      EXPECT_NEAR(other.value_loss, one.value_loss, 1e-5);
    }
    const auto named = module->named_parameters(), start = built_in->named_parameters();
    double moved = 0;
    for (const auto& item : copy->named_parameters()) {
      const torch::Tensor weight = named["module." + replaced(replaced(item.key(), "rnn.", ""), ".", "_")];
      EXPECT_LT((weight - item.value()).abs().max().item<double>(), 2e-5) << item.key();  // Adam divides by small moments
      moved = std::max(moved, (item.value() - start[item.key()]).abs().max().item<double>());
    }
    EXPECT_GT(moved, 1e-3);
  }
}

}  // namespace
}  // namespace earshot
