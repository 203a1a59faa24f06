#pragma once

#include <torch/torch.h>

#include <cstdint>
#include <functional>

#include "policy/actor_critic.h"
#include "trainer/gae.h"
#include "trainer/rollout_buffer.h"

namespace earshot {

struct PpoConfig {
  double clip = 0.2, value_coefficient = 0.5, entropy_coefficient = 0.05;
  double learning_rate = 2.5e-4, adam_epsilon = 1e-5, max_gradient_norm = 0.2;
  int epochs = 2, minibatches = 2;      ///< minibatches split the envs, sequences stay whole
  bool clip_value_loss = true, normalize_advantages = false;
  bool linear_learning_rate_decay = false, linear_clip_decay = false;
  GaeConfig gae;
};
void read(ConfigReader& reader, PpoConfig& config);
void validate(const PpoConfig& config);

/// The pieces of one PPO loss; all scalars.
struct PpoLoss {
  torch::Tensor total, policy, value, entropy;
  torch::Tensor approx_kl, clip_fraction;   ///< detached
};
/// log_prob, old_log_prob, advantages, values, old_values, returns, entropy, valid: [N]; rows with valid == 0 do not count.
/// policy = -mean min(r A, clip(r) A), r = exp(clamp(log_prob - old_log_prob, -20, 20)); value = 0.5 mean max((v - R)^2, (v_clipped - R)^2);
/// total = policy + value_coefficient value - entropy_coefficient mean entropy.  (Schulman et al. 2017, eqs. 7 and 9.)
PpoLoss ppo_loss(const torch::Tensor& log_prob, const torch::Tensor& old_log_prob, const torch::Tensor& advantages, const torch::Tensor& values,
                 const torch::Tensor& old_values, const torch::Tensor& returns, const torch::Tensor& entropy, const torch::Tensor& valid,
                 double clip, const PpoConfig& config);

/// Means over the minibatches of one update.
struct UpdateStats {
  double policy_loss = 0, value_loss = 0, entropy = 0, approx_kl = 0, clip_fraction = 0, gradient_norm = 0;
  double explained_variance = 0;  ///< NaN if the returns do not vary
  int skipped_steps = 0;          ///< optimizer steps left out because the averaged gradient was not finite
  double learn_s = 0, reduce_s = 0;
};

/// Averages a flat float buffer over all workers in place; the identity for one worker.
using AverageGradients = std::function<void(std::span<float> buffer)>;

/// PPO with Adam over all parameters of one policy.  The gradient of each minibatch is averaged over workers before clipping and stepping, so all
/// workers keep equal weights.  A non-finite averaged gradient skips the step on every worker alike.
class PpoLearner {
 public:
  PpoLearner(ActorCritic policy, const PpoConfig& config, std::uint64_t seed);
  /// progress: share of training done, [0, 1], for the decays.  update: its index, keys the minibatch permutation.
  UpdateStats update(const RolloutBuffer& rollout, double progress, std::uint64_t update, const AverageGradients& average);
  torch::optim::Adam& optimizer() { return optimizer_; }

 private:
  ActorCritic policy_;
  PpoConfig config_;
  torch::optim::Adam optimizer_;
  std::uint64_t seed_;
  std::vector<float> flat_gradient_;
};

}  // namespace earshot
