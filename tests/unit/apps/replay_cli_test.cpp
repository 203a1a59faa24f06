// SPDX-License-Identifier: Apache-2.0
// `earshot replay`: the file that a faulty episode leaves, run again by the program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>

#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

struct ReplayOutcome {
  int exit_code = -1;
  std::string text;
};

ReplayOutcome earshot(const TestFolder& folder, const std::string& arguments) {
  const std::filesystem::path output = folder.path() / "output";
  const int status = std::system((earshot::earshot_program().string() + " " + arguments + " >" + output.string() + " 2>&1").c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(output)};
}

TEST(ReplayCli, AMissingSceneRecursUntilItIsThere) {
  const TestFolder folder("replay_cli"), quarantine("replay_cli_quarantine");
  EnvConfig config = quick_env_config();
  config.quarantine_dir = quarantine.path().string();
  config.scene_root = folder.path().string();
  config.prefetch = false;
  {
    std::vector<Episode> episodes{room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise"),
                                  room_episode("gone.obj", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")};
    for (std::size_t i = 0; i < episodes.size(); ++i) episodes[i].episode_id = std::to_string(i);
    config.order = EpisodeOrder::once;
    BatchedEnv env(config, make_set(episodes), make_scene_cache(config), 2);
    env.reset();
  }
  ASSERT_EQ(quarantine.files().size(), 1u);
  const std::string file = quarantine.files()[0].string();

  const ReplayOutcome missing = earshot(folder, "replay " + file);
  EXPECT_EQ(missing.exit_code, 0) << missing.text;
  EXPECT_THAT(missing.text, testing::HasSubstr("gone.obj"));
  EXPECT_THAT(missing.text, testing::HasSubstr("recurs      yes"));

  write_text(folder.path() / "gone.obj", room_obj(6, 3, 5));
  const ReplayOutcome found = earshot(folder, "replay " + file + " --set scene_root=" + folder.path().string());
  EXPECT_EQ(found.exit_code, 0) << found.text;
  EXPECT_THAT(found.text, testing::HasSubstr("recurs      no"));
}

TEST(ReplayCli, WhatIsNoSuchFileIsRefused) {
  const TestFolder folder("replay_cli_bad");
  write_text(folder.path() / "other.json", "{\"success\": 1}");
  for (const std::string& file : {(folder.path() / "other.json").string(), (folder.path() / "none.json").string()}) {
    const ReplayOutcome outcome = earshot(folder, "replay " + file);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_THAT(outcome.text, testing::HasSubstr(file));
  }
}

}  // namespace
}  // namespace earshot
