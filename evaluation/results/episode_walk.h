// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "envs/config/env_config.h"
#include "envs/task/episode.h"
#include "sim/nav/geodesic_field.h"
#include "sim/scene/scene.h"

namespace earshot {

/// scene_id: as SceneCache takes it, looked up under scene_root.  Throws InputError.
std::shared_ptr<const Scene> load_scene_under(const std::string& scene_id, const std::string& scene_root);

/// A scene as far as walking needs it: neither its acoustics nor its looks.
struct WalkedScene {
  std::shared_ptr<const Scene> scene;
  Navmesh navmesh;
};
/// scene_id: as load_scene_under with config.scene_root.
WalkedScene load_walked_scene(const std::string& scene_id, const EnvConfig& config);

/// Result of recorded actions.
struct WalkOutcome {
  EpisodeMetrics metrics;
  std::string fault = {};  ///< why the actions are not one whole episode, in words; empty: they are
};

/// Takes the recorded actions from the start of an episode and measures them, with the arithmetic of BatchedEnv and the same bits: its
/// task, navmesh, seed and agents decide, its sensors and acoustics do not, but for the lengths of clips that are played once.
/// stream, episode_count: those of the env that ran the episode (errors of actuation are drawn by them); with EpisodeOrder::once and n envs
/// the index modulo n, and divided by n.  goal: of scene.navmesh, at the place of episode.goal_position.  config.agents must be 1.  Never
/// throws for what an episode or its actions may hold but InputError: a further goal lies off the surface, a sound is missing.
/// Tens of microseconds a step; safe from any thread.
WalkOutcome walk_episode(const EnvConfig& config, const WalkedScene& scene, const GeodesicField& goal, const Episode& episode,
                         std::span<const std::int8_t> actions, std::uint32_t stream, std::uint32_t episode_count);

}  // namespace earshot
