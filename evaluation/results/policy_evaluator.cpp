// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/policy_evaluator.h"

#include <optional>
#include <span>

#include "evaluation/results/episode_loop.h"
#include "evaluation/results/evaluator.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/rollout/actor.h"
#include "trainer/run/effective_config.h"

namespace earshot {

EvaluationResult evaluate_policy(const PolicyNetwork& policy, const EnvConfig& env_config, ActionChoice actions,
                                 const EvaluationConfig& evaluation, const std::string& name) {
  std::optional<Actor> actor;
  std::vector<ActingEnv> acting;
  const auto act = [&](BatchedEnv& env, std::span<std::int32_t> chosen) {
    if (!actor) actor.emplace(policy, 0, env.num_envs());
    const PolicyOutput& output = actor->observe(env);
    if (actions == ActionChoice::argmax) {
      greedy_actions(output.logits, chosen);
      return;
    }
    // Keyed by the episode, not by the env that happens to run it.
    acting.clear();
    for (int i = 0; i < env.num_envs(); ++i)
      acting.push_back({static_cast<std::uint32_t>(env.agent(i).episode_index), 0, static_cast<std::uint32_t>(env.agent(i).episode_step)});
    sample_actions(output.logits, acting, evaluation.seed, chosen);
  };
  return run_episodes(env_config, evaluation, name, act, [&](const BatchedEnv& env) { actor->advance(env); });
}

EvaluationResult evaluate_checkpoint(const CheckpointBytes& file, const EvaluationConfig& evaluation,
                                     const std::vector<std::string>& overrides) {
  use_one_torch_thread();
  const std::string where = file.path.string();
  const Checkpoint checkpoint = decode_checkpoint(file.bytes, where);
  const RunConfig config = config_of_checkpoint(checkpoint, where, overrides);
  const EnvConfig& env_config = evaluation.env ? *evaluation.env : config.env;
  const PolicyNetwork policy = network_of(checkpoint, env_config.observation, config.policy, where);

  EvaluationResult result = evaluate_policy(policy, env_config, evaluation.actions.value_or(config.eval_actions), evaluation, config.name);
  result.toolchain = this_toolchain();
  result.policy_hash = hex64(hash_of(checkpoint.weights, hash64(checkpoint.architecture)));
  return result;
}

EvaluationResult evaluate_checkpoint(const std::filesystem::path& checkpoint, const EvaluationConfig& evaluation,
                                     const std::vector<std::string>& overrides) {
  return evaluate_checkpoint(read_checkpoint(checkpoint), evaluation, overrides);
}

EvaluationResult evaluate_apart(PolicyProcess& policy, const std::string& name, const EvaluationConfig& evaluation) {
  EARSHOT_EXPECT(evaluation.env && evaluation.actions);
  const auto act = [&](BatchedEnv& env, std::span<std::int32_t> actions) {
    policy.act(env, *evaluation.actions, evaluation.seed, actions);
  };
  EvaluationResult result = run_episodes(*evaluation.env, evaluation, name, act, [&](const BatchedEnv& env) { policy.advance(env); });
  result.toolchain = this_toolchain();
  result.policy_hash = policy.policy_hash();
  return result;
}

}  // namespace earshot
