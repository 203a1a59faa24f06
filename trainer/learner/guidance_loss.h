// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

namespace earshot {

/// Mean cross-entropy -log pi(oracle's action) over the rows with valid != 0.  logits [N, A], oracle_action [N, 1] int32, valid [N].
torch::Tensor imitation_loss(const torch::Tensor& logits, const torch::Tensor& oracle_action, const torch::Tensor& valid);

/// How far goal [N, kGoalOutputs] is from goal_state [N, 4] (envs/sensors/sensor.h), mean over the rows with valid != 0: squared errors of
/// cosine and sine of both bearings and of log(1 + metres), and the cross-entropy of "nearer than near_m on foot", all with weight 1.
torch::Tensor goal_loss(const torch::Tensor& goal, const torch::Tensor& goal_state, double near_m, const torch::Tensor& valid);

}  // namespace earshot
