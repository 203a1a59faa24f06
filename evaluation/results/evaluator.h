// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "envs/baselines/baselines.h"
#include "envs/episodes/episode_set.h"
#include "envs/scenes/scene_cache.h"
#include "evaluation/results/policy_process.h"
#include "evaluation/results/result.h"
#include "trainer/checkpoint/checkpoint_bytes.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Of several processes that evaluate one set: each takes every `parts`-th round of episodes, a round being one for each env of the batch,
/// so that every episode runs in the env, with the number and in the row of the batch that it has in one process.
struct EvaluationPart {
  int part = 0, parts = 1;
  std::function<void(std::size_t done)> on_progress = {};  ///< called with the number of its episodes that have ended
  std::function<void()> on_step = {};                      ///< called before each step; what it throws ends the evaluation

  /// Of the episode with this number in the set, in batches of num_envs.
  [[nodiscard]] bool has(std::size_t episode, int num_envs) const {
    return episode / static_cast<std::size_t>(num_envs) % static_cast<std::size_t>(parts) == static_cast<std::size_t>(part);
  }
};

struct EvaluationConfig {
  std::string episodes;                               ///< set to run; each episode once
  std::map<std::string, std::string> generator = {};  ///< keys that the set must have been made from (generator_keys); empty: any set
  int num_envs = 8;                                   ///< fixed batch: part of the bits of policy inference
  int threads = 0;
  std::uint64_t seed = 0;                              ///< of the sampled actions
  std::optional<ActionChoice> actions = std::nullopt;  ///< none: as RunConfig::eval_actions says
  int max_episodes = 0;                                ///< 0: all
  /// Environment for a checkpoint, with sensors that fit its network; without one, that of its own config.
  std::optional<EnvConfig> env = std::nullopt;
  /// Only these episodes, the rows of the others stay empty; without: all.
  std::optional<EvaluationPart> part = std::nullopt;
  std::shared_ptr<const EpisodeSet> set = {};  ///< taken for what `episodes` names, and not read again; null: read
  std::shared_ptr<SceneCache> scenes = {};     ///< of the env that is run, for callers that evaluate again; null: one for this evaluation
};
/// Environments of a batch that runs so many episodes.
int evaluation_batch(const EvaluationConfig& evaluation, std::size_t num_episodes);

/// The episodes to run: those of the set, or the first of them.  whole: becomes the hash of the set that they are the first of.  Throws
/// InputError: no set, or one that was made from other keys.
std::shared_ptr<const EpisodeSet> load_evaluated_set(const EvaluationConfig& evaluation, std::string* whole = nullptr);

/// Runs a checkpoint (by its own config, scenes and sounds from the set) on every episode.  Same inputs, same bits.
EvaluationResult evaluate_checkpoint(const CheckpointBytes& checkpoint, const EvaluationConfig& evaluation,
                                     const std::vector<std::string>& overrides);
EvaluationResult evaluate_checkpoint(const std::filesystem::path& checkpoint, const EvaluationConfig& evaluation,
                                     const std::vector<std::string>& overrides);
/// Runs a policy of others, in its process, in evaluation.env: the bits of evaluate_checkpoint().  name: of the agent.  Throws InputError
/// as PolicyProcess does.
EvaluationResult evaluate_apart(PolicyProcess& policy, const std::string& name, const EvaluationConfig& evaluation);
/// Runs a baseline under the env of `config`.
EvaluationResult evaluate_baseline(Baseline baseline, const std::string& name, const EnvConfig& env, const EvaluationConfig& evaluation);

}  // namespace earshot
