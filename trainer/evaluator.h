#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "envs/baselines.h"
#include "trainer/result.h"
#include "trainer/run_config.h"

namespace earshot {

struct EvaluationConfig {
  std::string episodes;                               ///< set to run; each episode once
  std::map<std::string, std::string> generator = {};  ///< keys that the set must have been made from (generator_keys); empty: any set
  int num_envs = 8;                                   ///< fixed batch: part of the bits of policy inference
  int threads = 0;
  std::uint64_t seed = 0;                              ///< of the sampled actions
  std::optional<ActionChoice> actions = std::nullopt;  ///< none: as RunConfig::eval_actions says
  int max_episodes = 0;                                ///< 0: all
};

/// Runs a checkpoint (by its own config, scenes and sounds from the set) on every episode.  Same inputs, same bits.
EvaluationResult evaluate_checkpoint(const std::filesystem::path& checkpoint, const EvaluationConfig& evaluation,
                                     const std::vector<std::string>& overrides);
/// Runs a baseline under the env of `config`.
EvaluationResult evaluate_baseline(Baseline baseline, const std::string& name, const EnvConfig& env, const EvaluationConfig& evaluation);

}  // namespace earshot
