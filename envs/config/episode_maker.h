// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "envs/config/data_config.h"
#include "envs/episodes/episode_set.h"
#include "envs/scenes/scene_cache.h"
#include "envs/task/episode.h"

namespace earshot {

/// Makes the episodes of one scene after another.  One thread.
class EpisodeMaker {
 public:
  /// Throws InputError: no sound, a damaged range.
  EpisodeMaker(const DataConfig& data, const TaskConfig& task, std::shared_ptr<SceneCache> scenes);
  /// scene: without a range.  A function of (data, task, scene); episode_id is empty.  Throws InputError: a scene that cannot be loaded or
  /// has too few places.
  std::vector<Episode> make(const std::string& scene);

 private:
  DataConfig data_;
  TaskConfig task_;
  std::vector<std::string> sounds_;
  AgentScenario agents_;
  std::shared_ptr<SceneCache> scenes_;
};

/// The episodes of all data.scenes, ranges expanded, with the set's hash; episode_id is the number in the set.  progress: called after each
/// scene with the number of those that are done.  Throws as EpisodeMaker.
EpisodeSet make_episodes(const DataConfig& data, const TaskConfig& task, std::shared_ptr<SceneCache> scenes,
                         const std::function<void(std::size_t done)>& progress = {});

}  // namespace earshot
