// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/batch_setup.h"

#include <fmt/format.h>

#include <cmath>
#include <span>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {

BatchSetup::BatchSetup(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int envs,
                       int first, int total)
    : config(env_config),
      set(std::move(episodes)),
      scenes(std::move(cache)),
      num_envs(envs),
      first_env(first),
      total_envs(total > 0 ? total : first + envs),
      block_samples((validate(config), static_cast<int>(std::lround(config.acoustics.sample_rate_hz * config.task.step_time_s)))),
      heard(heard_files_of(config, set->episodes)),
      sounds(config.observation.hears() ? std::span<const Episode>(set->episodes) : std::span<const Episode>{}, config.sound_root,
             config.acoustics.sample_rate_hz, config.sound_gain),
      per_env(size_of(config.agents)) {
  require(config.accuracy.empty(), "accuracy", config.accuracy,
          "must be planned before environments are created: call plan_env_accuracy()");
  require(num_envs >= 1, "num_envs", num_envs, "must be at least 1");
  require(first_env >= 0 && first_env + num_envs <= total_envs, "first_env", first_env, "first_env + num_envs must not exceed total_envs");
  if (set->episodes.empty()) throw InputError("episode set", "contains no episodes", "write a set with 'earshot dataset episodes'");
  for (const Episode& episode : set->episodes)
    if (episode.other_agents.size() + 1 < per_env)
      throw InputError("episode '" + episode.episode_id + "' in " + episode.scene_id,
                       fmt::format("has {} agents, but env.agents is {}", episode.other_agents.size() + 1, per_env),
                       "set env.agents to the number of agents in the set, or write the set again (data.train.agents.count, 'earshot "
                       "dataset episodes --agents')");
  EARSHOT_EXPECT(scenes->acoustics().sample_rate_hz == config.acoustics.sample_rate_hz);
}

}  // namespace earshot
