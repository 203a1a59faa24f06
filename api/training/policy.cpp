// SPDX-License-Identifier: Apache-2.0
#include "earshot/policy.h"

#include <fmt/format.h>

#include <vector>

#include "api/vector_env_model.h"
#include "policy/action_distribution.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/rollout/actor.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/policy_file.h"

namespace earshot::api {

struct Policy::Model {
  Checkpoint checkpoint;
  std::string where;  ///< how messages name it
};

namespace {

RunConfig run_config_of(const Policy::Model& model) {
  return parse_effective_config(model.checkpoint.config_yaml, model.where + " (its config)", {});
}

/// The network of this policy with its weights.
PolicyNetwork network_of(const Policy::Model& model, const ObservationSpec& observation) {
  return earshot::network_of(model.checkpoint, observation, run_config_of(model).policy, model.where);
}

}  // namespace

Policy Policy::load(const std::filesystem::path& path) {
  use_one_torch_thread();
  const std::filesystem::path file = find_checkpoint(path);
  return Policy(std::make_shared<const Model>(Model{load_checkpoint(file), file.string()}));
}

Policy Policy::untrained(const Config& run) {
  use_one_torch_thread();
  const RunConfig config = parse_run_config(run.yaml, run.where, run.overrides.texts());
  const PolicyNetwork network = make_policy(config.env.observation, config.policy);
  Checkpoint checkpoint;
  checkpoint.config_yaml = earshot::config_text(config);
  checkpoint.architecture = network->architecture();
  checkpoint.seed = config.seed;
  checkpoint.weights = weights_of(network);
  checkpoint.module = network->module_file();
  return Policy(std::make_shared<const Model>(Model{policy_of(checkpoint, WeightStorage::float32), run.where}));
}

std::string Policy::description() const { return describe_policy(model_->checkpoint, model_->where); }
std::string Policy::config_text() const { return model_->checkpoint.config_yaml; }
std::uint64_t Policy::hash() const { return hash_of(model_->checkpoint.weights, hash64(model_->checkpoint.architecture)); }
std::int64_t Policy::num_parameters() const { return network_of(*model_, run_config_of(*model_).env.observation)->num_parameters(); }

void Policy::save(const std::filesystem::path& path, bool float16) const {
  save_checkpoint(policy_of(model_->checkpoint, float16 ? WeightStorage::float16 : WeightStorage::float32), path);
}

struct Agent::Model {
  const BatchedEnv* env;
  AgentOptions options;
  Actor actor;
  std::vector<ActingEnv> acting = {};
  std::vector<std::int32_t> actions = {};
};

Agent::Agent(const Policy& policy, const VectorEnv& envs, const AgentOptions& options) {
  const BatchedEnv& env = envs.model().env;
  // load_weights compares the architecture, which names sensors and shapes.
  model_ = std::make_unique<Model>(Model{&env, options, Actor(network_of(*policy.model(), env.config().observation), 0, env.num_rows())});
  model_->actions.resize(static_cast<std::size_t>(env.num_rows()));
}
Agent::~Agent() = default;
Agent::Agent(Agent&&) noexcept = default;

std::span<const std::int32_t> Agent::act() {
  const BatchedEnv& env = *model_->env;
  const PolicyOutput& output = model_->actor.observe(env);
  if (!model_->options.sample) {
    greedy_actions(output.logits, model_->actions);
    return model_->actions;
  }
  // Keyed by the episode and the agent, as in evaluations: not by the env that happens to run it.
  model_->acting.clear();
  for (int row = 0; row < env.num_rows(); ++row) {
    const AgentPlace place = env.agent(row);
    model_->acting.push_back({static_cast<std::uint32_t>(place.episode_index), static_cast<std::uint32_t>(row % env.config().agents),
                              static_cast<std::uint32_t>(place.episode_step)});
  }
  sample_actions(output.logits, model_->acting, model_->options.seed, model_->actions);
  return model_->actions;
}

void Agent::observe_step() { model_->actor.advance(*model_->env); }

}  // namespace earshot::api
