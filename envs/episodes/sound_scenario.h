// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "envs/episodes/episode_generator.h"

namespace earshot {

/// When the sound of the goal is heard in generated episodes, and what else is.  As it stands: the goal alone, without beginning or end.
/// SAVi (Chen, Al-Halah and Grauman 2021, "Semantic audio-visual navigation") and SAVN-CE draw the onset from 0 to 5 s and the duration
/// from a normal distribution of 15 s and 9 s.
struct SoundScenario {
  float onset_low_s = 0, onset_high_s = 0;         ///< uniform
  float duration_mean_s = -1, duration_std_s = 0;  ///< normal, at least kMinDurationS; a mean below 0: to the end of the episode
  int distractors = 0;                             ///< other sounds at other places of the scene, playing throughout
  float distractor_level_db = 0;                   ///< over the level of their clips
  float noise_snr_db = kNoNoiseDb;                 ///< Episode::noise_snr_db; kNoNoiseDb and more: none
  static constexpr float kMinDurationS = 1, kNoNoiseDb = 200;

  /// Whether episodes differ from those of the AudioNav layout.
  [[nodiscard]] bool changes_episodes() const;
  [[nodiscard]] bool has_sources() const { return onset_high_s > 0 || duration_mean_s >= 0 || distractors > 0; }
};
void read(ConfigReader& reader, SoundScenario& scenario);
/// Throws InputError "key = value: rule".
void validate(const SoundScenario& scenario);

/// Gives the episodes of one scene their sources and noise.  places: where distractors may stand, in the coordinates of the scene's file;
/// one at least 1 m from the goal must be among them where there are distractors.  A function of (episodes, seed) and the arguments.
void apply_scenario(const SoundScenario& scenario, std::span<const std::string> sounds, std::span<const glm::dvec3> places,
                    std::uint64_t seed, std::span<Episode> episodes);

}  // namespace earshot
