// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/evaluator.h"

#include <gtest/gtest.h>

#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/quarantine_cases.h"

namespace earshot {
namespace {

// An episode that cannot begin is a failure as far from its goal as it began, in one process and as the part of one of several.
TEST(Evaluator, AnEpisodeThatCannotBeginEndsWhereItBegan) {
  const TestFolder folder("evaluator");
  EnvConfig env = quick_env_config();
  env.observation.depth = env.observation.spectrogram = false;
  env.quarantine_dir = (folder.path() / "quarantine").string();
  std::vector<Episode> episodes = quarantine_cases::room_episodes(5);
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    episodes[i].episode_id = std::to_string(i);
    episodes[i].geodesic_distance_m = 2.5f + static_cast<float>(i);
  }
  episodes[1].scene_id = episodes[4].scene_id = "no_such_scene.glb";
  const auto set = make_set(episodes);
  save_episode_set(*set, folder.path() / "set.json");
  EvaluationConfig config;
  config.episodes = (folder.path() / "set.json").string();
  config.num_envs = 2;
  config.threads = 1;
  const auto expect_failed = [&](const EvaluationResult& result, std::size_t index) {
    EXPECT_EQ(result.episodes[index].metrics.success, 0) << index;
    EXPECT_EQ(result.episodes[index].metrics.spl, 0) << index;
    EXPECT_EQ(result.episodes[index].metrics.steps, 0) << index;
    EXPECT_FLOAT_EQ(static_cast<float>(result.episodes[index].metrics.dtg_m), 2.5f + static_cast<float>(index)) << index;
  };
  const EvaluationResult whole = evaluate_baseline(Baseline::random_oracle_stop, "random", env, config);
  ASSERT_EQ(whole.episodes.size(), 5u);
  expect_failed(whole, 1);
  expect_failed(whole, 4);
  // Rounds of two: episodes 0, 1 and 4 are of the first of two processes.
  config.part = EvaluationPart{.part = 0, .parts = 2};
  const EvaluationResult of_part = evaluate_baseline(Baseline::random_oracle_stop, "random", env, config);
  expect_failed(of_part, 1);
  expect_failed(of_part, 4);
}

}  // namespace
}  // namespace earshot
