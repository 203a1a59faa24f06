// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/sound_scenario.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <iterator>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr double kFromTheGoalM = 1;
/// The third counter of an episode's draws: attempts of the generator stay far below.
constexpr std::uint32_t kSourcesOfTheEpisode = 0xFFFFFFFEu;
struct SoundDraw {
  enum : std::uint32_t { onset, duration, first_distractor };
};

}  // namespace

bool SoundScenario::changes_episodes() const { return has_sources() || noise_snr_db < kNoNoiseDb; }

void read(ConfigReader& reader, SoundScenario& scenario) {
  constexpr float none_db = SoundScenario::kNoNoiseDb;
  reader.read("onset_low_s", scenario.onset_low_s, Allowed::at_least(0), "Earliest onset of the goal's sound; at most onset_high_s.");
  reader.read("onset_high_s", scenario.onset_high_s, Allowed::between(0, 1e5), "Latest onset of the goal's sound, which is uniform.");
  reader.read("duration_mean_s", scenario.duration_mean_s, Allowed::any().up_to(1e5),
              "Mean duration of the goal's sound, which is normal and at least 1 s. Negative: to the end of the episode.");
  reader.read("duration_std_s", scenario.duration_std_s, Allowed::between(0, 1e5), "Standard deviation of the duration.");
  reader.read("distractors", scenario.distractors, Allowed::between(0, static_cast<double>(kMaxSources) - 1),
              "Other sounds at other places of the scene, which play throughout.");
  reader.read("distractor_level_db", scenario.distractor_level_db, Allowed::between(-60, 60),
              "Level of distractors over the level of their clips.");
  reader.read("noise_snr_db", scenario.noise_snr_db, Allowed::between(-none_db, none_db),
              "Level of the goal's sound at 1 m over white noise at both ears. 200: no noise.");
}

void validate(const SoundScenario& scenario) {
  check_values(scenario, "scenario");
  require(scenario.onset_low_s <= scenario.onset_high_s, "scenario.onset_low_s", scenario.onset_low_s, "must be in [0, onset_high_s]");
  require(scenario.duration_mean_s >= 0 || scenario.duration_std_s == 0, "scenario.duration_std_s", scenario.duration_std_s,
          "has no effect without duration_mean_s");
  require(scenario.distractors > 0 || scenario.distractor_level_db == 0, "scenario.distractor_level_db", scenario.distractor_level_db,
          "has no effect without distractors");
}

void apply_scenario(const SoundScenario& scenario, std::span<const std::string> sounds, std::span<const glm::dvec3> places,
                    std::uint64_t seed, std::span<Episode> episodes) {
  validate(scenario);
  for (std::size_t index = 0; index < episodes.size(); ++index) {
    Episode& episode = episodes[index];
    if (scenario.noise_snr_db < SoundScenario::kNoNoiseDb) episode.noise_snr_db = scenario.noise_snr_db;
    if (!scenario.has_sources()) continue;
    const RandomStream random(seed, Purpose::episode, static_cast<std::uint32_t>(hash64(episode.scene_id)),
                              static_cast<std::uint32_t>(index), kSourcesOfTheEpisode);
    EpisodeSource goal{.position = episode.goal_position, .sound = episode.sound, .goal = true};
    const float span_s = scenario.onset_high_s - scenario.onset_low_s;
    goal.onset_s = static_cast<double>(scenario.onset_low_s + span_s * random.uniform(SoundDraw::onset));
    if (scenario.duration_mean_s >= 0)
      goal.duration_s = static_cast<double>(std::max(
          SoundScenario::kMinDurationS, scenario.duration_mean_s + scenario.duration_std_s * random.normal2(SoundDraw::duration)[0]));
    episode.sources = {goal};

    std::vector<glm::dvec3> free;
    std::copy_if(places.begin(), places.end(), std::back_inserter(free),
                 [&](glm::dvec3 place) { return glm::distance(place, episode.goal_position) >= kFromTheGoalM; });
    std::vector<std::string> other_sounds;
    std::copy_if(sounds.begin(), sounds.end(), std::back_inserter(other_sounds),
                 [&](const std::string& sound) { return sound != episode.sound; });
    if (scenario.distractors > 0 && (free.empty() || other_sounds.empty()))
      throw InputError(episode.scene_id, "has no free position for a distractor, or the set has no second sound",
                       "give more sounds, use a larger scene, or set scenario.distractors to 0");
    for (int i = 0; i < scenario.distractors; ++i) {
      const std::uint32_t draw = SoundDraw::first_distractor + 2 * static_cast<std::uint32_t>(i);
      episode.sources.push_back({.position = free[random.below(static_cast<std::uint32_t>(free.size()), draw)],
                                 .sound = other_sounds[random.below(static_cast<std::uint32_t>(other_sounds.size()), draw + 1)],
                                 .level_db = scenario.distractor_level_db});
    }
  }
}

}  // namespace earshot
