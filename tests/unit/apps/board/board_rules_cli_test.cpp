// SPDX-License-Identifier: Apache-2.0
// What a benchmark lets a policy sense, and what a submission may do to the machine that evaluates it, through the commands.

#include "tests/support/programs/board_rules_cli.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "envs/episodes/episode_set.h"
#include "envs/episodes/gzip.h"
#include "evaluation/leaderboard/benchmark.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST_F(BoardRulesCli, WhoReadsTheGoalIsRefusedOrShownApart) {
  const std::string ears = policy("ears", "");
  const std::string cheat = policy("cheat",
                                   "env.observation.spectrogram=false env.observation.pointgoal=true env.observation.topdown_map=true "
                                   "env.observation.map.goal=true");
  expect_done("eval " + ears + board() + " --out " + path("ears.json"));
  expect_refused("eval " + cheat + board() + " --out " + path("cheat.json"), HasSubstr("reads 'pointgoal', which is privileged"));
  EXPECT_FALSE(std::filesystem::exists(path("cheat.json")));
  expect_done("eval " + cheat + board() + " --track anything --out " + path("cheat.json"));
  expect_done("eval oracle" + board() + " --name DeepEar-XL --out " + path("oracle.json") + " --json " + path("own.json"));
  EXPECT_TRUE(json_of("own.json")["agents"][0]["rank"].is_null());
  // Without the benchmark it can run as it likes, and is not taken then.
  expect_done("eval " + cheat + " --episodes " + path("eval.json.gz") + " --out " + path("free.json"));
  expect_refused("verify " + path("free.json") + board(), HasSubstr("reads 'pointgoal'"));

  const std::string results = path("ears.json") + " " + path("cheat.json") + " " + path("oracle.json");
  expect_done("verify " + results + board());
  const std::string run_here = " --run-here ears --run-here cheat --run-here DeepEar-XL";
  expect_done("leaderboard " + results + board() + run_here + " --json " + path("table.json") + " --html " + path("table.html"));
  const nlohmann::json table = json_of("table.json");
  for (const auto& row : table["agents"]) {
    const std::string agent = row["agent"];
    EXPECT_EQ(row["rank"].is_null(), agent != "ears") << row;
    EXPECT_EQ(row["track"], agent == "ears" ? "ears" : "anything") << row;
    EXPECT_EQ(row["rests_on"], "run by the board");
    EXPECT_TRUE(row["verified"]);
  }
  const std::string page = read_file(path("table.html"));
  EXPECT_THAT(page, AllOf(HasSubstr("DeepEar-XL (baseline oracle)"), HasSubstr("not ranked"), HasSubstr("run by the board")));
  const Outcome said = earshot("leaderboard " + results + board() + " --run-here ears");
  EXPECT_THAT(said.text, AllOf(HasSubstr("actions alone"), HasSubstr("cheat is not ranked"), HasSubstr("DeepEar-XL (baseline oracle)")));
}

TEST_F(BoardRulesCli, OverridesOfABenchmarkAreLocalOrRefused) {
  const std::string eval = "eval greedy" + board() + " --set ";
  for (const std::string key : {"env.sound_gain=0.01", "env.acoustics.rays=1", "env.task.success_radius_m=3", "env.seed=9",
                                "env.observation.pointgoal=true", "env.navmesh.agent_radius_m=0.05"})
    expect_refused(eval + key, AllOf(HasSubstr(key.substr(0, key.find('='))), HasSubstr("it is fixed")));
  expect_refused(eval + "nonsense.key=3", HasSubstr("nonsense"));
  expect_refused("eval random" + board() + " --set nonsense.key=3", HasSubstr("nonsense"));
  expect_refused("eval random" + board() + " --track ears", HasSubstr("cannot be asked for"));
  expect_refused("eval random --config " + path("tiny.yaml") + " --track anything", HasSubstr("needs a benchmark"));
  expect_done("eval random" + board() + " --set env.threads=1 --set env.scene_cache_gb=1 --out " + path("result.json"));
  expect_done("verify " + path("result.json") + board());
}

// A policy file says where its training kept fields, scenes and faults: whoever evaluates it does not write there.
TEST_F(BoardRulesCli, NothingIsWrittenWhereAPolicySays) {
  const std::string kept = " env.field_store=" + path("evil/fields") + " env.scene_store=" + path("evil/scenes") +
                           " env.quarantine_dir=" + path("evil/faults") + " env.acoustics.field=on metrics_file=" + path("evil/metrics");
  const std::string file = policy("kept", kept);
  std::filesystem::remove_all(path("evil"));
  expect_done("eval " + file + board() + " --set env.field_store=" + path("own"));
  expect_done("eval " + file + " --episodes " + path("eval.json.gz") + " --out " + path("result.json"));
  expect_done("replay " + path("result.json") + " --episode 0 --policy " + file + " --html " + path("page.html"));
  EXPECT_FALSE(std::filesystem::exists(path("evil")));
}

TEST_F(BoardRulesCli, WhatNeverEndsOrGrowsIsRefusedAtOnce) {
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  const auto at_once = [&](const std::string& arguments, const testing::Matcher<std::string>& line) {
    const std::string said = bash("ulimit -v 6000000; timeout 300 " + earshot_program().string() + " " + arguments + "; echo code $?");
    EXPECT_THAT(said, AllOf(line, HasSubstr("code 2\n"))) << arguments;
  };
  for (const std::string& file : {path("pipe"), std::string("/dev/zero")}) {
    at_once("eval random --config " + path("tiny.yaml") + " --episodes " + file, HasSubstr("is a device, a pipe or a socket"));
    at_once("verify " + file, HasSubstr("is a device, a pipe or a socket"));
    at_once("leaderboard " + file, HasSubstr("is a device, a pipe or a socket"));
    at_once("verify " + path("pipe") + " --benchmark " + file, HasSubstr("is a device, a pipe or a socket"));
  }
  at_once("eval " + path("pipe") + board(), HasSubstr("pipe"));
  write_file_atomically(path("bomb.json.gz"), gzip("{\"episodes\": [" + std::string(std::size_t{100} << 20, ' ') + "]}"));
  at_once("eval random --config " + path("tiny.yaml") + " --episodes " + path("bomb.json.gz"), HasSubstr("gzip stream contains more than"));
  write_text(path("large.json"), "{\"episodes\": [" + std::string(kMaxResultBytes, ' ') + "]}");
  at_once("verify " + path("large.json"), HasSubstr("is larger than"));
}

}  // namespace
}  // namespace earshot
