// SPDX-License-Identifier: Apache-2.0
// Evaluations and sweeps by several processes, stopped and gone on with.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "tests/support/programs/board_cli.h"

namespace earshot {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

TEST_F(BoardCli, AnyNumberOfProcessesGivesTheSameBytes) {
  make_episodes(7);
  expect_done("train " + path("tiny.yaml"));
  const std::string noisy = " --set env.task.actuation_noise.forward_m=0.02 --set env.observation.gps_compass=true";
  for (const std::string& agent : {path("run"), "random --config " + path("tiny.yaml") + noisy}) {
    const std::string common = "eval " + agent + " --episodes " + path("eval.json.gz") + " --seed 3 --out ";
    expect_done(common + path("one.json"));
    EXPECT_EQ(json_of("one.json")["episodes"].size(), 7u);
    for (const std::string workers : {"2", "5"}) {  // five: one of them has nothing to do
      expect_done(common + path("several.json") + " --workers " + workers);
      EXPECT_EQ(read_file(path("several.json")), read_file(path("one.json"))) << agent << ", " << workers << " workers";
    }
  }
}

TEST_F(BoardCli, PartsOfAnyNumberAndOrderGiveTheSameBytes) {
  make_episodes(7);
  expect_done("train " + path("tiny.yaml"));
  std::mt19937 random(5);
  for (const std::string& agent : {path("run"), "random --config " + path("tiny.yaml") + " --set env.observation.gps_compass=true"}) {
    const std::string common = "eval " + agent + " --episodes " + path("eval.json.gz") + " --seed 3 --out ";
    expect_done(common + path("one.json"));
    for (const int parts : {1, 2, 3, 5, 9}) {  // of 7 episodes: some have nothing to do
      std::vector<int> order(static_cast<std::size_t>(parts));
      std::iota(order.begin(), order.end(), 1);
      std::ranges::shuffle(order, random);
      std::filesystem::remove_all(path("parts"));
      std::filesystem::remove(path("joined.json"));
      for (const int part : order) {
        EXPECT_FALSE(std::filesystem::exists(path("joined.json"))) << "before all parts are there";
        expect_done(common + path("joined.json") + fmt::format(" --shard {}/{} --parts {}", part, parts, path("parts")));
      }
      EXPECT_EQ(read_file(path("joined.json")), read_file(path("one.json"))) << agent << ", " << parts << " parts";
    }
  }
}

TEST_F(BoardCli, RunsOfASweepOneByOneGiveTheSweep) {
  make_episodes(2);
  for (const std::string out : {"whole", "apart"})
    write_text(path(out + ".yaml"),
               "config: " + path("tiny.yaml") + "\nname: n\nout: " + path(out) +
                   "\nseeds: [1, 2]\nset: [total_steps=64]\nevaluate: []\nruns: {base: [], fast: [ppo.learning_rate=1e-3]}\n");
  expect_done("sweep " + path("whole.yaml"));
  for (const std::string run : {"fast/seed_2", "base/seed_1", "base/seed_2", "fast/seed_1"}) {
    expect_done("sweep " + path("apart.yaml") + " --run " + run);
    EXPECT_FALSE(std::filesystem::exists(path("apart/sweep.json")));
  }
  expect_done("sweep " + path("apart.yaml") + " --report");
  const auto numbers = [&](const std::string& out) {  // without times and the path
    std::string text;
    const Json sweep = json_of(out + "/sweep.json");
    for (const Json& run : sweep["runs"])
      for (const Json& seed : run["seeds"])
        text += fmt::format("{} {} {} {} {} {}\n", run["run"].get<std::string>(), seed["seed"].dump(), seed["finished"].dump(),
                            seed["env_steps"].dump(), seed["held_out_success"].dump(), seed["held_out_spl"].dump());
    return text;
  };
  EXPECT_EQ(numbers("apart"), numbers("whole"));
  EXPECT_EQ(std::ranges::count(numbers("apart"), '\n'), 4);
  expect_refused("sweep " + path("apart.yaml") + " --run base/seed_3",
                 AllOf(HasSubstr("base/seed_3"), HasSubstr("base/seed_1, base/seed_2")));
  expect_refused("sweep " + path("apart.yaml") + " --run base/seed_1 --json " + path("numbers.json"), HasSubstr("--json"));
}

TEST_F(BoardCli, SweepsGoOnWhereTheyWereStopped) {
  make_episodes(2);
  const auto sweep_file = [&](const std::string& rate) {
    write_text(path("sweep.yaml"), "config: " + path("tiny.yaml") + "\nout: " + path("sweep") + "\nseeds: [1, 2]\nset: [total_steps=64]\n" +
                                       "runs: {base: [], fast: [ppo.learning_rate=" + rate + "]}\n");
  };
  sweep_file("1e-3");
  // Stopped in its first run: nothing is finished, and the same command goes on.
  const std::string said =
      bash("timeout -s TERM 2 " + earshot_program().string() + " sweep " + path("sweep.yaml") + " >/dev/null 2>&1; echo code $?");
  EXPECT_THAT(said, testing::AnyOf(HasSubstr("code 124"), HasSubstr("code 0")));
  expect_done("sweep " + path("sweep.yaml") + " --json " + path("numbers.json"));
  const Json numbers = json_of("numbers.json");
  EXPECT_EQ(numbers["schema_version"], 1);
  ASSERT_EQ(numbers["runs"].size(), 2u);
  for (const Json& run : numbers["runs"])
    for (const Json& seed : run["seeds"]) EXPECT_TRUE(seed["finished"] && seed["env_steps"] == 64) << seed;
  EXPECT_THAT(read_file(path("sweep/index.html")), AllOf(HasSubstr("<svg"), HasSubstr("ppo.learning_rate=1e-3")));
  EXPECT_THAT(read_file(path("sweep/table.txt")), HasSubstr("2/2"));

  // Finished runs stay as they are; those of other settings are not theirs.
  const auto log = std::filesystem::last_write_time(path("sweep/base/seed_1.log"));
  expect_done("sweep " + path("sweep.yaml"));
  EXPECT_EQ(std::filesystem::last_write_time(path("sweep/base/seed_1.log")), log);

  // Evaluated on the held-out set on request: the means of the results, without training again.
  write_text(path("sweep.yaml"), read_file(path("sweep.yaml")) + "evaluate: [eval_envs=1]\n");
  expect_done("sweep " + path("sweep.yaml") + " --json " + path("numbers.json"));
  const Json evaluated = json_of("numbers.json");
  for (const Json& run : evaluated["runs"])
    for (const Json& seed : run["seeds"]) {
      const EvaluationResult result =
          load_result(path("sweep/" + run["run"].get<std::string>() + "/seed_" + std::to_string(seed["seed"].get<int>()) + ".result.json"));
      EXPECT_EQ(result.rules.at("envs"), "1");
      EXPECT_EQ(seed["held_out_success"], result.success().mean);
      EXPECT_EQ(seed["held_out_spl"], result.spl().mean);
    }
  EXPECT_THAT(read_file(path("sweep/table.txt")), HasSubstr("held-out SPL"));
  const auto result_time = std::filesystem::last_write_time(path("sweep/base/seed_1.result.json"));
  expect_done("sweep " + path("sweep.yaml"));
  EXPECT_EQ(std::filesystem::last_write_time(path("sweep/base/seed_1.result.json")), result_time);
  sweep_file("2e-3");
  expect_refused("sweep " + path("sweep.yaml"), AllOf(HasSubstr("fast/seed_1"), HasSubstr("settings that differ")));
  write_text(path("bad.yaml"), "config: " + path("tiny.yaml") + "\nseeds: [1]\nrun: {base: []}\n");
  expect_refused("sweep " + path("bad.yaml"), HasSubstr("runs"));
  // A run that is trained anew is evaluated anew.
  sweep_file("1e-3");
  write_text(path("sweep.yaml"), read_file(path("sweep.yaml")) + "evaluate: [eval_envs=1]\n");
  std::filesystem::remove_all(path("sweep/base/seed_1"));
  std::filesystem::remove(path("sweep/base/seed_1.done"));
  expect_done("sweep " + path("sweep.yaml"));
  EXPECT_GT(std::filesystem::last_write_time(path("sweep/base/seed_1.result.json")), result_time);
  write_text(path("bad.yaml"), "config: " + path("tiny.yaml") + "\nout: " + path("other") +
                                   "\nseeds: [1]\nruns: {base: []}\nevaluate: [data.eval.file=" + path("no.json.gz") + "]\n");
  expect_refused("sweep " + path("bad.yaml"), HasSubstr("no.json.gz"));
  write_text(path("bad.yaml"), "config: " + path("tiny.yaml") + "\nseeds: [1]\nruns: {base: []}\nevaluate: [env.tusk=1]\n");
  expect_refused("sweep " + path("bad.yaml"), HasSubstr("tusk"));
}

}  // namespace
}  // namespace earshot
