// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"
#include "sim/acoustics/accuracy/accuracy_plan.h"

namespace earshot {

/// Acoustic settings that meet env.accuracy for the episodes of a set.
struct EnvAccuracy {
  EnvConfig config;   ///< accuracy empty, acoustics with what was chosen: the same observations without a planner
  AccuracyPlan plan;  ///< tried and predicted
  int scenes = 0;     ///< that were tried
};

/// The cheapest acoustics within config.accuracy (AccuracyTarget), chosen in up to three scenes of the set, evenly spread over its list of
/// scenes: one goal of each, at places along the way from its episode's start.  Errors are the largest of these scenes; a more reverberant
/// or larger scene of the set may have larger errors.  A field costs once per goal and serves the responses of its episodes, each as many
/// steps as
/// its oracle takes and at least kStepsPerEpisode; other settings of the acoustics, such as rir_length_s, stay.
///
/// config.accuracy must not be empty.  Cost: seconds to a minute or two a scene.  Throws InputError as AccuracyTarget::parse and
/// plan_accuracy, and for scenes and goals that cannot be loaded.
EnvAccuracy plan_env_accuracy(const EnvConfig& config, const EpisodeSet& set, const std::function<void(double fraction)>& progress = {});
inline constexpr int kStepsPerEpisode = 100;

}  // namespace earshot
