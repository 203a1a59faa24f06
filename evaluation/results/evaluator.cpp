// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/evaluator.h"

#include <algorithm>
#include <optional>
#include <span>

#include "evaluation/results/episode_loop.h"
#include "sim/base/files.h"
#include "trainer/run/episode_data.h"

namespace earshot {

std::shared_ptr<const EpisodeSet> load_evaluated_set(const EvaluationConfig& evaluation, std::string* whole) {
  if (evaluation.set) return evaluation.set;
  EpisodeSet set = load_episode_set(evaluation.episodes);
  check_generator(
      set, evaluation.generator, evaluation.episodes,
      "write it again with 'earshot dataset episodes --config CONFIG', or use it unchanged with --episodes " + evaluation.episodes);
  if (evaluation.max_episodes > 0 && set.episodes.size() > static_cast<std::size_t>(evaluation.max_episodes)) {
    if (whole != nullptr) *whole = hex64(set.hash);
    set.episodes.resize(static_cast<std::size_t>(evaluation.max_episodes));
    set.hash = episode_set_hash(set.episodes);
  }
  return std::make_shared<const EpisodeSet>(std::move(set));
}

int evaluation_batch(const EvaluationConfig& evaluation, std::size_t num_episodes) {
  return static_cast<int>(std::min<std::size_t>(static_cast<std::size_t>(evaluation.num_envs), num_episodes));
}

EvaluationResult evaluate_baseline(Baseline baseline, const std::string& name, const EnvConfig& env, const EvaluationConfig& evaluation) {
  std::optional<BaselineAgent> agent;
  const auto act = [&](BatchedEnv& batch, std::span<std::int32_t> actions) {
    if (!agent) agent.emplace(baseline, batch.config(), batch.num_rows(), evaluation.seed);
    agent->act(batch, actions);
  };
  EvaluationResult result = run_episodes(env, evaluation, name, act, [](const BatchedEnv&) {});
  result.policy_hash = name;
  result.baseline = baseline_name(baseline);
  return result;
}

}  // namespace earshot
