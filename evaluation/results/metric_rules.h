// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "envs/config/env_config.h"

namespace earshot {

/// What the metrics of an evaluation depend on beside episodes and actions, by the keys of the env section with their values as text: the
/// sections task and navmesh, seed and agents, acoustics.sample_rate_hz (lengths of clips); `hears`, whether any sensor does, and `envs`,
/// the size of the batch, which the errors of actuation are drawn by.  Folders are not among them: scenes are named by the episodes.
using MetricRules = std::map<std::string, std::string>;

MetricRules metric_rules(const EnvConfig& env, int num_envs);

/// Rules for verifying a result of a benchmark: those of the benchmark, except for settings that affect no ranked number: rewards, whether
/// and at which rate the agent hears, and without errors of actuation the seed and the size of the batch are the result's.
MetricRules rules_for(const MetricRules& of_result, const MetricRules& of_benchmark);

/// The env of these rules, without pictures.
struct RuledEnv {
  EnvConfig env;
  int num_envs = 1;
};
/// scene_root, sound_root: as EnvConfig's.  Throws InputError that names `where`: a rule is missing, unknown or out of its range.
RuledEnv env_of_rules(const MetricRules& rules, const std::string& where, const std::string& scene_root = {},
                      const std::string& sound_root = {});

}  // namespace earshot
