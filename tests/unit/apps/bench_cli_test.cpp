// SPDX-License-Identifier: Apache-2.0
// Runs the benchmarks as a script does: names, layout of the JSON, exit codes.  The numbers of these short runs have no meaning.

#include "tests/support/programs/bench_cli.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "sim/base/text/json.h"

namespace earshot {
namespace {

using nlohmann::json;

TEST_F(BenchCli, BitsAreThoseOfAnyThreadsRestoredOrNot) {
  const std::string pinned = (earshot::source_dir() / "tests/pinned").string();
  const std::string bits = "bench bits --envs 2 --env " + pinned + "/batch.yaml --episodes " + pinned + "/episodes.json";
  ASSERT_EQ(earshot(bits + " --steps 12 --json " + file("bits.json")), 0) << read("stderr");
  const json report = parse_json(read("bits.json"));
  EXPECT_EQ(report.at("schema_version"), 1);
  const std::string hash = report.at("hash");
  EXPECT_EQ(hash.size(), 16u);
  ASSERT_EQ(earshot(bits + " --steps 12 --threads 2 --restored 3"), 0) << read("stderr");
  EXPECT_EQ(read("stdout").substr(0, 16), hash);
  ASSERT_EQ(earshot(bits + " --steps 13"), 0) << read("stderr");
  EXPECT_NE(read("stdout").substr(0, 16), hash);
  std::ofstream(file("bad.yaml")) << "sead: 3\n";
  EXPECT_EQ(earshot("bench bits --env " + file("bad.yaml") + " --episodes " + pinned + "/episodes.json"), 2);
  EXPECT_THAT(read("stderr"), testing::HasSubstr("sead"));
}

TEST_F(BenchCli, RirWritesTheNamesThatScriptsRelyOn) {
  ASSERT_EQ(earshot("bench rir --quick --json " + file("rir.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("rir.json", "rir");
  for (const char* name :
       {"fast.rir_per_s.n50", "fast.rir_per_s.n150", "fast.rir_per_s.n500", "fast.rir_per_s.n2000", "fast.rir_per_s.warm",
        "fast.rt60_error_pct.energy", "fast.rt60_error_pct.rir", "fast.drr_error_db", "high.rir_per_s", "high.rt60_standard_error_pct",
        "high_field.rir_per_s", "high_field.rt60_standard_error_pct", "observation_per_s"})
    EXPECT_EQ(names.count(name), 1u) << name;
  // The source's cost spreads over more RIRs: rates rise with n, and serving n costs no more than that many warm ones and the source.
  const json results = parse_json(read("rir.json")).at("results");
  double last = 0;
  for (const json& result : results) {
    if (!result.at("name").get<std::string>().starts_with("fast.rir_per_s.")) continue;
    EXPECT_GT(result.at("value"), last);
    last = result.at("value");
    for (const char* key : {"scene", "triangles", "n", "threads", "rir_length_s", "rays"})
      EXPECT_TRUE(result.at("setting").contains(key)) << key;
  }
  EXPECT_THAT(read("stdout"), testing::HasSubstr("photon pass"));
}

TEST_F(BenchCli, PromiseSaysWhatWasPromisedPredictedAndMeasured) {
  ASSERT_EQ(earshot("bench promise --quick --scene shoebox:5x4x3@0.3 --target t20=20% --json " + file("promise.json")), 0)
      << read("stderr");
  const std::set<std::string> names = names_in("promise.json", "promise");
  for (const char* name : {"promise.t20=20%.kept", "promise.t20=20%.predicted_t20", "promise.t20=20%.measured_t20",
                           "promise.t20=20%.truth_error_t20", "promise.t20=20%.total_ms", "promise.t20=20%.calibration_s"})
    EXPECT_EQ(names.count(name), 1u) << name;
  EXPECT_THAT(read("stdout"), testing::HasSubstr("| shoebox:5x4x3@0.3 | t20=20% | "));
}

TEST_F(BenchCli, EnvWritesTheNamesThatScriptsRelyOn) {
  ASSERT_EQ(earshot("bench env --quick --json " + file("env.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("env.json", "env");
  for (const char* name :
       {"env.steps_per_s", "env.bare_steps_per_s", "env.stage_ms.trace", "env.stage_ms.synthesize", "env.stage_ms.convolve",
        "env.stage_ms.render", "env.stage_ms.observe", "env.batch_step_ms.p50", "env.batch_step_ms.p95", "env.batch_step_ms.p99",
        "env.batch_step_ms.max", "env.memory.resident_mb", "env.memory.cache_mb", "env.bare_steps_per_s.without_oracle",
        "env.bare_rays_per_s.camera", "env.bare_rays_per_s.diffuse"})
    EXPECT_EQ(names.count(name), 1u) << name;
}

TEST_F(BenchCli, EnvTakesSceneAgentsPictureThreadsAndFields) {
  ASSERT_EQ(
      earshot("bench env --quick --scene house:5,rooms=2,area_m2=24 --envs 3 --size 64x32 --threads 2 --field --json " + file("env.json")),
      0)
      << read("stderr");
  const json report = parse_json(read("env.json"));
  int rates = 0;
  for (const json& result : report.at("results")) {
    if (result.at("name") != "env.steps_per_s") continue;
    ++rates;
    const json& setting = result.at("setting");
    EXPECT_EQ(setting.at("scene"), "house:5,rooms=2,area_m2=24");
    EXPECT_EQ(setting.at("envs"), 3);
    EXPECT_EQ(setting.at("threads"), 2);
    EXPECT_EQ(setting.at("camera_px"), 64);
    EXPECT_EQ(setting.at("camera_height_px"), 32);
    EXPECT_EQ(setting.at("field"), true);
  }
  EXPECT_EQ(rates, 1);
  for (const char* wrong : {"--size 64", "--size 64x", "--size 63x32", "--envs 0", "--threads -1", "--scene nowhere.glb"})
    EXPECT_EQ(earshot("bench env --quick " + std::string(wrong)), 2) << wrong << read("stderr");
}

TEST_F(BenchCli, WrongNamesAreOneLineAndExitCodeTwo) {
  for (const char* arguments :
       {"bench", "bench dance", "bench trian", "bench rir --raya 3", "bench accuracy --quick --minutes 0",
        "bench rir --quick --scene shoebox:5x4x3 --scene shoebox:0x4x3", "bench rir --quick --reference-seconds 0",
        "bench rir --quick --reference-poses 0", "bench promise --quick --target t20=5", "bench accuracy --quick --engine mine",
        "bench accuracy --quick --engine 'mine=exit 3;'", "bench accuracy --quick --engine mine=true"}) {
    EXPECT_EQ(earshot(arguments), 2) << arguments;
    const std::string errors = read("stderr");
    EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
  }
}

TEST_F(BenchCli, TrainWritesRatesOfTheLearnerAndOfAShortTraining) {
  {
    std::ofstream config(file("small.yaml"));
    config << "envs_per_worker: 2\nrollout_steps: 4\n"
              "env: {observation: {camera: {width_px: 40, height_px: 40}}, acoustics: {preset: fast, field: off, rir_length_s: 0.1}}\n"
              "policy: {hidden_size: 16, visual_features: 8, audio_features: 8, conv_channels: 4}\n"
              "ppo: {epochs: 2, minibatches: 2}\n"
              "data: {train: {scenes: [\"shoebox:8x3x8\"], sounds: [\"synth:click\"], filter: {min_geodesic_m: 1, max_geodesic_m: 20, "
              "min_ratio: 0}}}\n";
  }
  ASSERT_EQ(earshot("bench train --quick --config " + file("small.yaml") + " --set ppo.epochs=3 --json " + file("train.json")), 0)
      << read("stderr");
  const std::set<std::string> names = names_in("train.json", "train");
  for (const char* name :
       {"learner.samples_per_cpu_s", "learner.samples_per_s", "learner.update_ms.forward", "learner.update_ms.backward",
        "learner.update_ms.step", "learner.update_ms.other", "actor.rows_per_cpu_s", "train.steps_per_s", "train.stage_ms.sound",
        "train.stage_ms.convolve", "train.stage_ms.render", "train.stage_ms.move", "train.stage_ms.policy", "train.stage_ms.learn"})
    EXPECT_EQ(names.count(name), 1u) << name;
  // Beside torch where a python has it, else with a line that says how to get it.
  EXPECT_EQ(names.count("torch.samples_per_cpu_s") + (read("stdout").find("torch left out") != std::string::npos), 1u);
  EXPECT_EQ(names.count("torch.samples_per_cpu_s"), names.count("learner.ratio_to_torch"));
  const json report = parse_json(read("train.json"));
  for (const json& result : report.at("results")) {
    EXPECT_EQ(result.at("setting").at("epochs"), 3) << result;
    for (const char* key : {"config", "parameters", "envs", "rollout_steps", "minibatches", "threads"})
      EXPECT_TRUE(result.at("setting").contains(key)) << key;
  }
}

TEST_F(BenchCli, TrainRefusesWhatItCannotDo) {
  EXPECT_EQ(earshot("bench train --config " + file("none.yaml")), 2);
  EXPECT_NE(read("stderr").find("none.yaml"), std::string::npos);
  EXPECT_EQ(earshot("bench train --seconds 0"), 2);
  EXPECT_NE(read("stderr").find("--seconds"), std::string::npos);
  EXPECT_EQ(earshot("bench train --repeats 0"), 2);
  EXPECT_NE(read("stderr").find("--repeats"), std::string::npos);
  EXPECT_EQ(earshot("bench train --set ppo.epoch=2"), 2);
  EXPECT_NE(read("stderr").find("ppo.epoch"), std::string::npos);
}

}  // namespace
}  // namespace earshot
