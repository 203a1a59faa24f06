// SPDX-License-Identifier: Apache-2.0
#include "policy/policy_network.h"

#include "policy/actor_critic.h"
#include "policy/module_policy.h"
#include "sim/base/errors.h"

namespace earshot {

PolicyOutput PolicyNetworkImpl::step(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) {
  return sequence(observations, hidden, not_done.unsqueeze(0));
}

std::int64_t PolicyNetworkImpl::num_parameters() const {
  std::int64_t count = 0;
  for (const torch::Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

void PolicyNetworkImpl::register_value_scale() {
  if (!config_.normalize_values) return;
  value_mean_ = register_buffer("value_mean", torch::zeros({1}));
  value_deviation_ = register_buffer("value_deviation", torch::ones({1}));
}

torch::Tensor PolicyNetworkImpl::scaled_value(const torch::Tensor& value) const {
  return config_.normalize_values ? value * value_deviation() + value_mean() : value;
}

void PolicyNetworkImpl::move_value_scale(double mean, double deviation, torch::Tensor weight, torch::Tensor bias) {
  EARSHOT_EXPECT(config_.normalize_values && deviation > 0);
  const torch::NoGradGuard no_gradient;
  const double ratio = value_deviation() / deviation;
  weight.mul_(ratio);
  bias.mul_(ratio).add_((value_mean() - mean) / deviation);
  value_mean_.fill_(mean);
  value_deviation_.fill_(deviation);
}

PolicyNetwork make_policy(const ObservationSpec& spec, const PolicyConfig& config) {
  if (config.module.empty()) return ActorCritic(spec, config);
  return std::make_shared<ModulePolicyImpl>(spec, config, read_module_file(config.module), "policy.module " + config.module);
}

}  // namespace earshot
