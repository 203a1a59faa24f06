// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"
#include "envs/hearing/heard_files.h"
#include "envs/hearing/sound_library.h"
#include "envs/scenes/scene_cache.h"

namespace earshot {

inline std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

/// The constants of a batch: config, episode set, scenes and sounds.  Immutable after construction, so that all threads may read it.
struct BatchSetup {
  /// Opens every sound of the set where a sensor hears.  total_envs: of all workers; 0: first_env + num_envs.  Throws InputError for a
  /// config that no batch can have, an empty set, and a set whose episodes have fewer agents than config.agents.
  BatchSetup(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int envs,
             int first, int total);

  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
  int num_envs, first_env, total_envs;
  int block_samples;  ///< of sound in a step
  HeardFiles heard;
  SoundLibrary sounds;
  std::size_t per_env;  ///< agents

  [[nodiscard]] std::uint32_t global_id(std::size_t env) const {
    return static_cast<std::uint32_t>(first_env) + static_cast<std::uint32_t>(env);
  }
  [[nodiscard]] std::size_t num_rows() const { return size_of(num_envs) * per_env; }
  /// Samples of the analysed window: the sound at the start of an episode.
  [[nodiscard]] int window_samples() const { return config.observation.sound.num_samples; }
};

}  // namespace earshot
