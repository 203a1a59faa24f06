// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "envs/config/data_config.h"
#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"
#include "sim/base/text/config_key.h"

namespace earshot {

/// Section `env` of a run config.  Throws as read(ConfigReader&, EnvConfig&), and for an unknown key.
void read_env_section(ConfigReader& run, EnvConfig& env);
/// Section `data` of a run config: `train`, `eval` and `held_out`.  Throws as read(ConfigReader&, DataConfig&), and for an unknown key.
void read_data_section(ConfigReader& run, DataConfig& train, DataConfig& eval, DataConfig& held_out);
/// Defaults of data.train.  Training visits a scene thousands of times: ten goals teach it, and a source field made for each serves
/// thousands of responses.  Evaluation asks about goals that were not seen, a new one in every episode.
DataConfig training_data();

/// All keys of a config of environments alone: those of an env section at the top, and `episodes`.
std::vector<ConfigKey> env_config_keys();

/// Environments and the episodes that they draw from: what BatchedEnv takes.
struct BatchParts {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
};

/// Reads YAML (JSON is part of it).  A run config, with the sections `env` and `data`: reads those two, of data the part `split`; the other
/// sections are for `earshot train`.  Otherwise: the keys of an env section at the top, and the episodes under `episodes`.
///
/// Episodes: `scenes`, and as in a run config `sounds`, episodes_per_scene, goals_per_scene, seed, filter, scenario and agents: made here,
/// in memory, the same as `earshot train` makes for the same keys; or without scenes `file`, a set to read.
/// acoustics.field = auto and accuracy are decided for these episodes, each walked once (field_choice.h, env_accuracy.h).
/// where: how messages name the text.  overrides: "a.b=value" over the text; env_overrides: the same from the env section on.
/// episodes: taken instead of what the text says of episodes, which it may then leave out.
/// Throws InputError.
BatchParts read_batch(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
                      const std::vector<std::string>& env_overrides, const std::string& split,
                      std::shared_ptr<const EpisodeSet> episodes = nullptr);

}  // namespace earshot
