// SPDX-License-Identifier: Apache-2.0
// Benchmarks that take a quarter of a minute each even in their shortest runs: names, layout of the JSON.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/programs/bench_cli.h"

namespace earshot {
namespace {

using nlohmann::json;

TEST_F(BenchCli, RirTakesAnySceneAndItsPathsAsTheTruth) {
  ASSERT_EQ(earshot("bench rir --quick --reference-seconds 0.3 --scene shoebox:5x4x3 --scene house:5,rooms=2,area_m2=24 --json " +
                    file("scenes.json")),
            0)
      << read("stderr");
  const std::set<std::string> names = names_in("scenes.json", "rir");
  EXPECT_EQ(names.count("fast.rir_per_s.n500"), 1u);
  EXPECT_EQ(names.count("high_field.rir_per_s"), 0u);
  EXPECT_EQ(names.count("fast.rt60_stated_error_pct"), 1u);
  EXPECT_EQ(names.count("fast.rt60_covered_pct"), 1u);
  std::set<std::string> scenes;
  const json report = parse_json(read("scenes.json"));
  for (const json& result : report.at("results")) {
    if (result.at("name") != "fast.rt60_error_pct.energy") continue;
    const json& setting = result.at("setting");
    scenes.insert(setting.at("spec").get<std::string>());
    EXPECT_EQ(setting.at("reference"), "paths");
    EXPECT_GE(setting.at("reference_runs"), 2);
    EXPECT_GT(setting.at("reference_rt60_standard_error_pct"), 0);
  }
  EXPECT_EQ(scenes, (std::set<std::string>{"shoebox:5x4x3", "house:5,rooms=2,area_m2=24"}));
}

TEST_F(BenchCli, AllReduceTimesEachWayWithItsSetting) {
  ASSERT_EQ(earshot("bench allreduce --quick --no-gloo --ranks 2,3 --json " + file("sums.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("sums.json", "allreduce");
  for (const char* way : {"shared_memory", "ipc", "tcp"}) EXPECT_EQ(names.count(std::string("allreduce.ms.") + way), 1u) << way;
  std::set<std::pair<int, int>> settings;
  const json report = parse_json(read("sums.json"));
  for (const json& result : report.at("results"))
    settings.insert({result.at("setting").at("ranks").get<int>(), result.at("setting").at("bytes").get<int>()});
  EXPECT_EQ(settings, (std::set<std::pair<int, int>>{{2, 4096}, {2, 262144}, {3, 4096}, {3, 262144}}));
  for (const char* wrong : {"--ranks 1", "--ranks 1025", "--no-mpi --ranks 65", "--kib 0", "--seconds 0", "--repeats 0"})
    EXPECT_EQ(earshot("bench allreduce --quick " + std::string(wrong)), 2) << wrong << read("stderr");
}

TEST_F(BenchCli, ScalingChecksItsModelAndPredicts) {
  ASSERT_EQ(earshot("bench scaling --quick --kib 512 --predict 8,128 --json " + file("scaling.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("scaling.json", "scaling");
  for (const char* name : {"scaling.update_ms", "scaling.prediction_error", "scaling.efficiency"}) EXPECT_EQ(names.count(name), 1u) << name;
  const json report = parse_json(read("scaling.json"));
  for (const json& result : report.at("results")) {
    if (result.at("name") != "scaling.efficiency") continue;
    EXPECT_GT(result.at("value").get<double>(), 0.1);
    EXPECT_LT(result.at("value").get<double>(), 1);
  }
  EXPECT_THAT(read("stdout"), testing::HasSubstr("assumptions:"));
  for (const char* wrong : {"--ranks 1", "--kib 4", "--predict 0", "--spread 2", "--updates 1", "--latency-us -1"})
    EXPECT_EQ(earshot("bench scaling --quick " + std::string(wrong)), 2) << wrong << read("stderr");
}

TEST_F(BenchCli, EnvFindsTheBestBatchHere) {
  ASSERT_EQ(earshot("bench env --quick --autotune --scene shoebox:8x3x8@0.3 --size 64x64 --json " + file("tune.json")), 0)
      << read("stderr");
  const std::set<std::string> names = names_in("tune.json", "env");
  for (const char* name : {"env.autotune.steps_per_s", "env.autotune.best_envs", "env.autotune.best_threads"})
    EXPECT_EQ(names.count(name), 1u) << name;
  EXPECT_THAT(read("stdout"), testing::HasSubstr("best: envs_per_worker="));
}

TEST_F(BenchCli, HearingComparesRaysWithTheField) {
  ASSERT_EQ(earshot("bench hearing --quick --scene house:5,rooms=2,area_m2=24 --json " + file("hearing.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("hearing.json", "hearing");
  for (const char* mode : {"rays16", "rays64", "rays256", "field"})
    for (const char* metric : {"steps_per_s", "rt60_error_pct.rir", "rt60_error_pct.energy", "spectrogram_error_db", "source_ms"})
      EXPECT_EQ(names.count("hearing." + std::string(mode) + "." + metric), 1u) << mode << metric;
  EXPECT_THAT(read("stdout"), testing::HasSubstr("| source field |"));
}

// An engine in a shell that says that its package is absent is left out, with a line in the tables.
TEST_F(BenchCli, AccuracyWritesItsTablesAndFigures) {
  const std::string engine = " --engine 'mine=echo no such package >&2; exit 69;'";
  ASSERT_EQ(earshot("bench accuracy --quick --minutes 0.05 --out " + file("out") + " --json " + file("accuracy.json") + engine), 0)
      << read("stderr");
  EXPECT_EQ(names_in("accuracy.json", "accuracy").count("accuracy.fast.rt60_rms_error_pct"), 1u);
  const std::string tables = read("out/accuracy_tables.md");
  for (const char* part : {"## Scenes and their truth", "## Bias and scatter", "## Presets, octave by octave", "## What is heard of it",
                           "## Cost against triangles and sources", "mine is left out: no such package", "| earshot, source field |"})
    EXPECT_THAT(tables, testing::HasSubstr(part));
  EXPECT_THAT(read("out/accuracy.csv"), testing::HasSubstr("t20_pct_bias,"));
  for (const char* figure : {"pareto", "scenes", "sweeps", "engines"})
    EXPECT_TRUE(read("out/accuracy_" + std::string(figure) + ".svg").starts_with("<svg ")) << figure;
}

}  // namespace
}  // namespace earshot
