#pragma once

#include <memory>
#include <string>
#include <vector>

#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"

namespace earshot::python {

/// Environments and the episodes that they draw from.
struct BatchParts {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
};

/// Reads YAML (JSON is part of it).  A run config, which has the sections `env` and `data`: those two are read, of data the part `split`;
/// what else it holds is for `earshot train`.  Otherwise: the keys of an env section at the top, and the episodes under `episodes`.
///
/// Episodes: `scenes`, and as in a run config `sounds`, episodes_per_scene, goals_per_scene, seed, filter, scenario and agents: made here,
/// in memory, the same as `earshot train` makes for the same keys; or without scenes `file`, a set to read.
/// acoustics.field = auto and accuracy are decided for these episodes, each walked once (field_choice.h, env_accuracy.h).
/// where: how messages name the text.  overrides: "a.b=value" over the text; env_overrides: the same from the env section on.
/// Throws InputError.
BatchParts read_batch(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
                      const std::vector<std::string>& env_overrides, const std::string& split);

}  // namespace earshot::python
