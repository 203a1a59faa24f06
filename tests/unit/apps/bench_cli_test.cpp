// Runs the benchmarks as a script does: names, layout of the JSON, exit codes.  The numbers of such short runs mean nothing.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "tests/support/test_paths.h"

namespace {

using nlohmann::json;

class BenchCli : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_bench_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  [[nodiscard]] std::string read(const std::string& name) const {
    std::ifstream stream(file(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  [[nodiscard]] int earshot(const std::string& arguments) const {
    const std::string command = earshot::earshot_program().string() + " " + arguments + " >" + file("stdout") + " 2>" + file("stderr");
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  /// Checks the contents that docs/formats.md, section 5.4 documents, and returns the names in it.
  [[nodiscard]] std::set<std::string> names_in(const std::string& name, const std::string& bench) const {
    const json report = json::parse(read(name));
    EXPECT_EQ(report.at("bench"), bench);
    EXPECT_TRUE(report.at("machine").at("cpu").is_string());
    EXPECT_GE(report.at("machine").at("cores"), 1);
    EXPECT_TRUE(report.at("commit").is_string());
    std::set<std::string> names;
    for (const json& result : report.at("results")) {
      names.insert(result.at("name").get<std::string>());
      EXPECT_TRUE(result.at("unit").is_string()) << result;
      EXPECT_TRUE(result.at("setting").is_object()) << result;
      if (result.at("value").is_null()) continue;
      EXPECT_LE(result.at("min"), result.at("value")) << result;
      EXPECT_GE(result.at("max"), result.at("value")) << result;
    }
    return names;
  }

  std::filesystem::path folder_;
};

TEST_F(BenchCli, BitsAreThoseOfAnyThreadsRestoredOrNot) {
  const std::string pinned = (earshot::source_dir() / "tests/pinned").string();
  const std::string bits = "bench bits --envs 2 --env " + pinned + "/batch.yaml --episodes " + pinned + "/episodes.json";
  ASSERT_EQ(earshot(bits + " --steps 12 --json " + file("bits.json")), 0) << read("stderr");
  const json report = json::parse(read("bits.json"));
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
  const json results = json::parse(read("rir.json")).at("results");
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
  const json report = json::parse(read("scenes.json"));
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
  const json report = json::parse(read("env.json"));
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

TEST_F(BenchCli, AllReduceTimesEachWayWithItsSetting) {
  ASSERT_EQ(earshot("bench allreduce --quick --no-gloo --ranks 2,3 --json " + file("sums.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("sums.json", "allreduce");
  for (const char* way : {"shared_memory", "ipc", "tcp"}) EXPECT_EQ(names.count(std::string("allreduce.ms.") + way), 1u) << way;
  std::set<std::pair<int, int>> settings;
  const json report = json::parse(read("sums.json"));
  for (const json& result : report.at("results"))
    settings.insert({result.at("setting").at("ranks").get<int>(), result.at("setting").at("bytes").get<int>()});
  EXPECT_EQ(settings, (std::set<std::pair<int, int>>{{2, 4096}, {2, 262144}, {3, 4096}, {3, 262144}}));
  for (const char* wrong : {"--ranks 1", "--ranks 65", "--kib 0", "--seconds 0", "--repeats 0"})
    EXPECT_EQ(earshot("bench allreduce --quick " + std::string(wrong)), 2) << wrong << read("stderr");
}

TEST_F(BenchCli, ScalingChecksItsModelAndPredicts) {
  ASSERT_EQ(earshot("bench scaling --quick --kib 512 --predict 8,128 --json " + file("scaling.json")), 0) << read("stderr");
  const std::set<std::string> names = names_in("scaling.json", "scaling");
  for (const char* name : {"scaling.update_ms", "scaling.prediction_error", "scaling.efficiency"}) EXPECT_EQ(names.count(name), 1u) << name;
  const json report = json::parse(read("scaling.json"));
  for (const json& result : report.at("results")) {
    if (result.at("name") != "scaling.efficiency") continue;
    EXPECT_GT(result.at("value").get<double>(), 0.1);
    EXPECT_LT(result.at("value").get<double>(), 1);
  }
  EXPECT_THAT(read("stdout"), testing::HasSubstr("assumed:"));
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
    for (const char* what : {"steps_per_s", "rt60_error_pct.rir", "rt60_error_pct.energy", "spectrogram_error_db", "source_ms"})
      EXPECT_EQ(names.count("hearing." + std::string(mode) + "." + what), 1u) << mode << what;
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
  const json report = json::parse(read("train.json"));
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
