// SPDX-License-Identifier: Apache-2.0
// The part of trainer/checkpoint/checkpoint.h that moves weights and optimizer state between tensors by name and live modules.
#include <fmt/format.h>

#include "policy/actor_critic.h"
#include "policy/module_policy.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/learner/optimizer_key.h"

namespace earshot {
namespace {

std::map<std::string, torch::Tensor> live_tensors(const PolicyNetwork& policy) {
  std::map<std::string, torch::Tensor> tensors;
  for (const auto& item : policy->named_parameters()) tensors.emplace(item.key(), item.value());
  for (const auto& item : policy->named_buffers()) tensors.emplace(item.key(), item.value());
  return tensors;
}

}  // namespace

PolicyNetwork network_of(const Checkpoint& checkpoint, const ObservationSpec& spec, const PolicyConfig& config, const std::string& where) {
  PolicyNetwork policy;
  if (checkpoint.module)
    policy = std::make_shared<ModulePolicyImpl>(spec, config, checkpoint.module, where + " (its module)");
  else if (config.module.empty())
    policy = ActorCritic(spec, config);
  else
    throw InputError(where, "holds no module, but its config names one, policy.module " + config.module, "leave policy.module out");
  load_weights(policy, checkpoint, where);
  policy->eval();
  return policy;
}

std::map<std::string, torch::Tensor> weights_of(const PolicyNetwork& policy) {
  std::map<std::string, torch::Tensor> weights;
  for (const auto& [name, tensor] : live_tensors(policy)) weights.emplace(name, tensor.detach().clone());
  return weights;
}

std::uint64_t hash_of(const std::map<std::string, torch::Tensor>& weights, std::uint64_t start) {
  std::uint64_t hash = start;
  for (const auto& [name, tensor] : weights) {
    const torch::Tensor flat = tensor.contiguous();
    hash = hash64(std::span(static_cast<const std::byte*>(flat.data_ptr()), flat.nbytes()), hash);
  }
  return hash;
}

void load_weights(const PolicyNetwork& policy, const Checkpoint& checkpoint, const std::string& where) {
  const std::string remedy = "use the config and the sensors of the training";
  if (checkpoint.architecture != policy->architecture())
    throw InputError(
        where,
        fmt::format("has weights of the architecture '{}', but the config needs '{}'", checkpoint.architecture, policy->architecture()),
        remedy);
  const auto live = live_tensors(policy);
  // Everything is checked before anything is changed.
  for (const auto& [name, tensor] : checkpoint.weights)
    if (!live.contains(name)) throw InputError(where, fmt::format("has weights '{}' that the policy does not have", name), remedy);
  for (const auto& [name, tensor] : live) {
    const auto saved = checkpoint.weights.find(name);
    if (saved == checkpoint.weights.end()) throw InputError(where, fmt::format("has no weights '{}'", name), remedy);
    if (saved->second.sizes() != tensor.sizes() || saved->second.scalar_type() != tensor.scalar_type())
      throw InputError(where, fmt::format("has weights '{}' of the wrong shape or type", name), remedy);
    if (!torch::isfinite(saved->second).all().item<bool>())
      throw InputError(where, fmt::format("has weights '{}' with non-finite values", name), "use an earlier checkpoint");
  }
  const torch::NoGradGuard no_grad;
  for (const auto& [name, tensor] : live) tensor.detach().copy_(checkpoint.weights.at(name));
}

std::map<std::string, torch::Tensor> optimizer_state_of(const PolicyNetwork& policy, torch::optim::Adam& optimizer) {
  std::map<std::string, torch::Tensor> saved;
  for (const auto& item : policy->named_parameters()) {
    const auto found = optimizer.state().find(optimizer_key(item.value()));
    if (found == optimizer.state().end()) continue;  // never stepped
    const auto& state = static_cast<const torch::optim::AdamParamState&>(*found->second);
    saved.emplace(item.key() + ".step", torch::tensor(state.step(), torch::kInt64));
    saved.emplace(item.key() + ".exp_avg", state.exp_avg().detach().clone());
    saved.emplace(item.key() + ".exp_avg_sq", state.exp_avg_sq().detach().clone());
  }
  return saved;
}

void load_optimizer_state(const PolicyNetwork& policy, torch::optim::Adam& optimizer, const Checkpoint& checkpoint) {
  const auto refuse = [](const std::string& name, const std::string& problem) {
    throw InputError("optimizer state of the checkpoint", fmt::format("'{}' {}", name, problem), "use the config of the training");
  };
  std::size_t used = 0;
  std::vector<std::pair<decltype(optimizer_key({})), std::unique_ptr<torch::optim::AdamParamState>>> states;
  for (const auto& item : policy->named_parameters()) {
    const auto saved = [&](const std::string& suffix) { return checkpoint.optimizer.find(item.key() + suffix); };
    const auto step = saved(".step"), mean = saved(".exp_avg"), square = saved(".exp_avg_sq");
    const auto absent = checkpoint.optimizer.end();
    if (step == absent && mean == absent && square == absent) continue;
    if (step == absent || mean == absent || square == absent) refuse(item.key(), "is incomplete");
    if (step->second.scalar_type() != torch::kInt64 || step->second.numel() != 1 || step->second.item<std::int64_t>() < 0)
      refuse(item.key() + ".step", "is not a whole number");
    for (const auto& moment : {mean, square}) {
      if (moment->second.sizes() != item.value().sizes() || moment->second.scalar_type() != item.value().scalar_type())
        refuse(moment->first, "has a different shape or type than its weights");
      if (!torch::isfinite(moment->second).all().item<bool>()) refuse(moment->first, "has non-finite values");
    }
    used += 3;
    auto state = std::make_unique<torch::optim::AdamParamState>();
    state->step(step->second.item<std::int64_t>());
    state->exp_avg(mean->second.clone());
    state->exp_avg_sq(square->second.clone());
    states.emplace_back(optimizer_key(item.value()), std::move(state));
  }
  if (used != checkpoint.optimizer.size()) refuse("optimizer", "has entries for weights that the policy does not have");
  optimizer.state().clear();
  for (auto& [key, state] : states) optimizer.state().insert_or_assign(key, std::move(state));
}

Checkpoint learner_state_of(const PolicyNetwork& policy, torch::optim::Adam& optimizer) {
  Checkpoint learner;
  learner.architecture = policy->architecture();
  learner.weights = weights_of(policy);
  learner.optimizer = optimizer_state_of(policy, optimizer);
  return learner;
}

void load_learner_state(const PolicyNetwork& policy, torch::optim::Adam& optimizer, const Checkpoint& learner, const std::string& where) {
  load_weights(policy, learner, where);
  load_optimizer_state(policy, optimizer, learner);
}

}  // namespace earshot
