// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "envs/batch/batched_env.h"
#include "envs/scenes/env_scene.h"
#include "evaluation/results/result.h"

namespace earshot {

/// Of JPEG, in pages and MCAP files.
inline constexpr int kPictureQuality = 80;

/// Output of a policy for an observation.
struct PolicyJudgement {
  double value = 0;
  std::array<double, kNumActions> probabilities{};
};
/// Called once before each recorded action, with the env (of one row) as the agent finds it there; after_step once behind it.
struct PolicyObserver {
  std::function<PolicyJudgement(const BatchedEnv&)> judge = {};
  std::function<void(const BatchedEnv&)> after_step = {};
};

/// One observation of an episode and what led to it: number 0 is at the start, number k after action k.
struct RecordedStep {
  Pose pose;
  float reward = 0;  ///< of the action that led here
  bool collided = false;
  float walk_m = 0;                                ///< to the nearest goal on foot
  float straight_m = 0;                            ///< to it, horizontally
  double bearing_rad = 0;                          ///< of it, positive to the left of the heading
  std::array<double, 2> level_db{};                ///< of the sound of this step at the left and the right ear, re amplitude 1
  std::optional<double> heard_rad = std::nullopt;  ///< lateral angle of the sound by the ears; nullopt in silence
  std::optional<PolicyJudgement> judgement = {};   ///< none without a policy, and of the last observation
  std::vector<std::uint8_t> rgb = {};              ///< [height, width, 3] of RecordingConfig
  std::vector<float> depth = {};                   ///< of the agent's camera, where it has depth
  std::vector<glm::vec3> sources = {};             ///< where the sounds are by then, foot points
};

struct RecordingConfig {
  int width_px = 448, height_px = 336;  ///< of the colour pictures, which are drawn for people whatever the agent sees
};

/// An episode walked again with eyes and ears.
struct EpisodeRecording {
  EnvConfig env;  ///< used for the walk
  Episode episode;
  std::size_t index = 0;  ///< in its set
  EpisodeMetrics metrics;
  std::vector<std::int8_t> actions;
  RecordingConfig config;
  std::vector<RecordedStep> steps;  ///< one more than actions
  int samples_per_step = 0;
  std::vector<float> sound;  ///< [2, steps * samples_per_step]: left ear, then right; part k is what was heard up to observation k
  /// Of each source (Episode::sources, or the one at the goal) the first and the last observation in whose sound it plays by itself,
  /// without what the scene still gives back of it; none: it begins after the episode.
  std::vector<std::optional<std::array<std::size_t, 2>>> playing;
  std::vector<glm::vec3> goals;   ///< foot points
  std::vector<glm::vec3> oracle;  ///< places of the oracle from the start on
  int oracle_actions = 0;         ///< stop included
  std::shared_ptr<const EnvScene> scene;
  std::shared_ptr<const Appearance> looks;
};

/// Walks episode `index` of the set again by the actions of its row, with the sensors and acoustics of `env` and the task, navmesh and seed
/// of the result's rules.  observer: empty, or a policy of env's sensors.  Throws InputError that names `where`: the row is not an episode
/// of the set, or its actions give other numbers than it states.
EpisodeRecording record_episode(const EvaluationResult& result, const std::string& where, const EpisodeSet& set, std::size_t index,
                                const EnvConfig& env, const RecordingConfig& config = {}, const PolicyObserver& observer = {});

/// The row of a result that `text` names: a number from 0 on, or best, median or worst by SPL, then by fewer steps, then by number.
/// Throws InputError for anything else.
std::size_t find_episode(const EvaluationResult& result, const std::string& text);

}  // namespace earshot
