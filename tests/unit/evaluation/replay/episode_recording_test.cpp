// SPDX-License-Identifier: Apache-2.0
// An episode whose sound begins late and ends early, as a recording and as a page have it.
#include "evaluation/replay/episode_recording.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "envs/baselines/baselines.h"
#include "evaluation/replay/replay_page.h"
#include "evaluation/results/evaluator.h"
#include "sim/base/text/json.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

/// The oracle's way through a room of 6 x 5 m: more than twenty steps of 0.15 s.
EpisodeRecording recorded(const TestFolder& folder, const std::vector<EpisodeSource>& sources) {
  std::vector<Episode> episodes{room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")};
  episodes[0].episode_id = "0";
  episodes[0].sources = sources;
  for (EpisodeSource& source : episodes[0].sources)
    if (source.goal) source.position = episodes[0].goal_position;
  EnvConfig env = quick_env_config();
  env.task.max_steps = 80;
  const std::string file = (folder.path() / "set.json").string();
  save_episode_set(*make_set(episodes), file);
  EvaluationConfig evaluation;
  evaluation.episodes = file;
  evaluation.num_envs = 1;
  evaluation.threads = 1;
  const EvaluationResult result = evaluate_baseline(Baseline::oracle, "oracle", env, evaluation);
  return record_episode(result, "result", load_episode_set(file), 0, env, {.width_px = 32, .height_px = 24});
}

// Steps of 0.15 s; observation k has the sound from 0.15 (k - 1) s to 0.15 k s.  From 0.4 s to 1.2 s: the third, which ends at 0.45 s, to
// the eighth, which begins at 1.05 s.  Before, nothing is heard; while it plays, something is, once it has crossed the 3.6 m of the room;
// and when the room has rung out, nothing.
TEST(EpisodeRecording, TellsWhenEachSourcePlays) {
  const TestFolder folder("recording");
  const EpisodeRecording recording = recorded(folder, {{.sound = "synth:noise", .onset_s = 0.4, .duration_s = 0.8, .goal = true}});
  ASSERT_GT(recording.steps.size(), 20u);
  ASSERT_EQ(recording.playing.size(), 1u);
  EXPECT_EQ(recording.playing[0], (std::array<std::size_t, 2>{3, 8}));
  constexpr double kSilent = -140;  // dB of the level of steps without a sound
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(recording.steps[k].level_db[0], kSilent) << k;
  for (std::size_t k = 4; k <= 8; ++k) EXPECT_GT(recording.steps[k].level_db[0], kSilent + 40) << k;
  EXPECT_EQ(recording.steps.back().level_db[0], kSilent);
  EXPECT_EQ(recording.metrics.success_when_silent, 1);
  const auto json = parse_json(replay_json(recording, {}));
  EXPECT_EQ(json["sources"][0]["playing"], (std::vector<int>{3, 8}));
  EXPECT_EQ(json["metrics"]["success_when_silent"], 1);
}

TEST(EpisodeRecording, KnowsSourcesWithoutEndClipsAndThoseThatNeverPlay) {
  const TestFolder folder("recording_sources");
  const std::size_t last = recorded(folder, {}).steps.size() - 1;
  EXPECT_EQ(recorded(folder, {}).playing, (std::vector<std::optional<std::array<std::size_t, 2>>>{std::array<std::size_t, 2>{0, last}}));
  const SoundClip clip = open_sound("synth:noise", quick_env_config().acoustics.sample_rate_hz);
  const double length_s = static_cast<double>(clip.samples.size()) / static_cast<double>(clip.sample_rate_hz);
  const auto end = static_cast<std::size_t>(std::ceil(length_s / 0.15 - 1e-6));
  const EpisodeRecording several = recorded(folder, {{.sound = "synth:noise", .goal = true},
                                                     {.position = {1, 0, 4}, .sound = "synth:noise", .loop = false},
                                                     {.position = {5, 0, 1}, .sound = "synth:noise", .onset_s = 1000}});
  ASSERT_EQ(several.playing.size(), 3u);
  EXPECT_EQ(several.playing[0], (std::array<std::size_t, 2>{1, last}));
  EXPECT_EQ(several.playing[1], (std::array<std::size_t, 2>{1, std::min(end, last)}));
  EXPECT_EQ(several.playing[2], std::nullopt);
  const auto json = parse_json(replay_json(several, {}));
  EXPECT_TRUE(json["sources"][2]["playing"].is_null());
  EXPECT_FALSE(json["sources"][2]["goal"]);
}

}  // namespace
}  // namespace earshot
