// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/guidance_loss.h"

#include <torch/nn/functional/loss.h>

#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "sim/base/errors.h"

namespace earshot {

torch::Tensor imitation_loss(const torch::Tensor& logits, const torch::Tensor& oracle_action, const torch::Tensor& valid) {
  EARSHOT_EXPECT(logits.size(0) == oracle_action.size(0) && logits.size(0) == valid.size(0));
  const torch::Tensor counts = valid.to(torch::kBool).nonzero().squeeze(1);
  if (counts.numel() == 0) return (logits * 0).sum();
  return -log_probabilities(logits.index_select(0, counts), oracle_action.index_select(0, counts).squeeze(1).to(torch::kInt64)).mean();
}

torch::Tensor goal_loss(const torch::Tensor& goal, const torch::Tensor& goal_state, double near_m, const torch::Tensor& valid) {
  EARSHOT_EXPECT(goal.size(1) == kGoalOutputs && goal.size(0) == goal_state.size(0) && goal.size(0) == valid.size(0));
  const torch::Tensor counts = valid.to(torch::kBool).nonzero().squeeze(1);
  if (counts.numel() == 0) return (goal * 0).sum();
  const torch::Tensor said = goal.index_select(0, counts), is = goal_state.index_select(0, counts);
  const torch::Tensor metres = is.select(1, 0), bearing = is.select(1, 2), corner = is.select(1, 3);
  const torch::Tensor target = torch::stack({bearing.cos(), bearing.sin(), corner.cos(), corner.sin(), metres.log1p()}, 1);
  namespace F = torch::nn::functional;
  const torch::Tensor is_near = (metres < near_m).to(said.scalar_type());
  return (said.narrow(1, 0, 5) - target).square().sum(1).mean() + F::binary_cross_entropy_with_logits(said.select(1, 5), is_near);
}

}  // namespace earshot
