// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/optim/adam.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "policy/policy_network.h"
#include "trainer/collective/collective.h"
#include "trainer/learner/guidance_config.h"
#include "trainer/learner/ppo_config.h"
#include "trainer/learner/rollout_buffer.h"
#include "trainer/learner/step_agreement.h"

namespace earshot {

/// The pieces of one PPO loss; all scalars.
struct PpoLoss {
  torch::Tensor total, policy, value, entropy;
  torch::Tensor approx_kl, clip_fraction;   ///< detached
  torch::Tensor imitation = {}, goal = {};  ///< of GuidanceConfig, part of total where they are on, else undefined
};
/// log_prob, old_log_prob, advantages, values, old_values, returns, entropy, valid: [N]; rows with valid == 0 do not count.
/// policy = -mean min(r A, clip(r) A), r = exp(clamp(log_prob - old_log_prob, -20, 20)); value = 0.5 mean max((v - R)^2, (v_clipped -
/// R)^2); v_clipped = old_value + clamp(v - old_value, -clip, clip); without clip_value_loss, value = 0.5 mean (v - R)^2. total = policy +
/// value_coefficient value - entropy_coefficient mean entropy.  (Schulman et al. 2017, eqs. 7 and 9.) approx_kl = mean (r - 1 - log r) >=
/// 0; clip_fraction = fraction of rows with |r - 1| > clip. Rows that do not count may hold anything, NaN included; with no row left all is
/// 0, and so are the gradients.
PpoLoss ppo_loss(const torch::Tensor& log_prob, const torch::Tensor& old_log_prob, const torch::Tensor& advantages,
                 const torch::Tensor& values, const torch::Tensor& old_values, const torch::Tensor& returns, const torch::Tensor& entropy,
                 const torch::Tensor& valid, double clip, const PpoConfig& config);

/// A larger difference between the policy of the rollout and that of the learner before its first step is not rounding
/// (docs/explanation/ppo.md): a mask, a hidden state or an observation is not what the policy acted on.
inline constexpr double kMaxRatioError = 1e-4;

/// Means over the minibatches of one update.
struct UpdateStats {
  double policy_loss = 0, value_loss = 0, entropy = 0, approx_kl = 0, clip_fraction = 0, gradient_norm = 0;
  double imitation_loss = 0, goal_loss = 0;  ///< 0 where they are off
  /// Fraction of this worker's rows, before the first step, where the likeliest action is the oracle's; NaN without such rows.
  double oracle_agreement = std::numeric_limits<double>::quiet_NaN();
  int epochs = 0;                    ///< begun: fewer than configured where the KL budget ended them
  double explained_variance = 0;     ///< NaN if the returns do not vary
  int taken_steps = 0;               ///< optimizer steps, the same on every worker
  int skipped_steps = 0;             ///< optimizer steps that no worker took because something was not finite or not the same everywhere
  std::vector<SkippedStep> skipped;  ///< each of them: which one, why, which ranks; the same on every worker
  int non_finite_here = 0;           ///< number of non-finite losses or gradients of this worker
  /// Minibatches of all workers over PpoConfig::loss_alarm or kl_alarm, and the first worker that had one (-1: none).
  int loss_alarms = 0, kl_alarms = 0, alarm_rank = -1;
  double alarm_loss = 0, alarm_kl = 0;  ///< of that first one
  double max_ratio_error = 0;  ///< max |r - 1| before the first step: 0 up to rounding, or the recomputation differs from what acted
  double learn_s = 0, reduce_s = 0;
  double forward_s = 0, backward_s = 0, step_s = 0;  ///< parts of learn_s: losses, their gradients, Adam
};

/// PPO with Adam over all parameters of one policy.  The gradients of each minibatch are summed over workers, with the number of workers
/// that had rows beside them, and divided by that number before clipping and stepping, so all workers keep equal weights.  Before each step
/// the workers exchange statuses (step_agreement.h): if a loss, a gradient or a sum is not finite on any worker, or the sums differ, no
/// worker steps; weights and Adam's state stay as they are and the run goes on.
///
/// A minibatch is a part of the envs with their whole sequences; each env is in one minibatch per epoch.  The loss is the mean over the
/// valid rows of a worker's minibatch, and each worker that has such rows weighs the same (docs/explanation/ppo.md, section 5.1), or as
/// PpoConfig::preempt_weight says if a rollout ended early; a worker that has none joins the sum with weight 0.
class PpoLearner {
 public:
  /// near_m: distance at which the goal is reached, for GuidanceConfig::goal.
  PpoLearner(PolicyNetwork policy, const PpoConfig& config, std::uint64_t seed, const GuidanceConfig& guidance = {}, double near_m = 1);
  /// progress: fraction of training done, [0, 1], for the decays.  update: its index, keys the minibatch permutation.
  /// A collective call: a sum of the gradient and an exchange of statuses for each minibatch of each epoch (fewer epochs, the same on every
  /// worker, where target_kl ends them), and two sums of statistics if normalize_advantages is on, one more with normalized values and one
  /// with truncated weights, whatever this worker's rollout holds.  With one worker the collective does nothing.
  UpdateStats update(const RolloutBuffer& rollout, double progress, std::uint64_t update, Collective& collective);
  torch::optim::Adam& optimizer() { return optimizer_; }

 private:
  struct Rollout;  // rows [0, num_steps) with advantages and returns
  PpoLoss minibatch_loss(const Rollout& rollout, std::span<const std::int64_t> envs, double progress, bool is_first_minibatch,
                         UpdateStats& stats);
  /// Loss and gradient of this worker's part of a minibatch, into flat_gradient_ and `stats`; what it has to say about them.
  StepStatus accumulate_gradient(const Rollout& rollout, std::span<const std::int64_t> envs, double progress, bool is_first_minibatch,
                                 UpdateStats& stats);
  double clip_and_step(double squared_sum);  // of the summed flat_gradient_, without its last element; returns the norm before clipping

  PolicyNetwork policy_;
  PpoConfig config_;
  GuidanceConfig guidance_;
  double near_m_;
  torch::optim::Adam optimizer_;
  std::uint64_t seed_;
  torch::Tensor flat_gradient_;  // [parameters + 1]: the parameters' gradients are views into it; the last element is the worker's weight
};

}  // namespace earshot
