// Runs the program as a user does and looks at its exit code and at what it prints.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

namespace {

using testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  std::string output, errors;
};

class Cli : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_cli_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }
  [[nodiscard]] std::string read(const std::string& name) const {
    std::ifstream stream(file(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  [[nodiscard]] Outcome earshot(const std::string& arguments) const {
    const std::string command = std::string(EARSHOT_BINARY) + " " + arguments + " >" + file("stdout") + " 2>" + file("stderr");
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read("stdout"), read("stderr")};
  }
  /// Exit code 2 and one line on stderr that holds `text`; nothing of the promised output exists.
  void expect_bad_input(const std::string& arguments, const std::string& text) const {
    const Outcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr(text)) << arguments;
    EXPECT_EQ(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
  }

  std::filesystem::path folder_;
};

TEST_F(Cli, HelpIsCompleteAndUnknownCommandsAreRefused) {
  const Outcome help = earshot("--help");
  EXPECT_EQ(help.exit_code, 0);
  for (const char* command : {"doctor", "scene", "rir", "walk", "dataset", "train", "eval", "leaderboard"}) {
    EXPECT_THAT(help.output, HasSubstr(command));
    EXPECT_EQ(earshot(std::string(command) + " --help").exit_code, 0) << command;
  }
  EXPECT_EQ(earshot("dance").exit_code, 2);
  EXPECT_EQ(earshot("").exit_code, 2);
  EXPECT_EQ(earshot("rir shoebox:5x3x4").exit_code, 2);
}

TEST_F(Cli, DoctorReportsTheMachine) {
  const Outcome outcome = earshot("doctor");
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* part : {"CPU", "Embree", "BLAS", "libtorch", "camera"}) EXPECT_THAT(outcome.output, HasSubstr(part));
}

TEST_F(Cli, BadScenesAreOneLineAndExitCodeTwo) {
  expect_bad_input("scene " + file("none.glb"), "does not exist");
  expect_bad_input("scene " + write("empty.obj", "# nothing\n"), "empty.obj");
  expect_bad_input("scene " + write("nan.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n"), "nan.obj");
  expect_bad_input("scene shoebox:5x4", "shoebox");
  expect_bad_input("scene shoebox:5x3x4@unobtainium", "unobtainium");
  write("room.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_bad_input("scene " + write("key.yaml", "mesh: room.obj\ncieling_m: 3\n"), "did you mean 'ceiling_m'");
  expect_bad_input("scene " + write("material.yaml", "mesh: room.obj\nassign: {\"*\": brik}\n"), "brik");
}

TEST_F(Cli, BadConfigsAndFilesAreOneLineAndExitCodeTwo) {
  expect_bad_input("train " + file("none.yaml"), "no such file");
  expect_bad_input("train " + write("typo.yaml", "ppo: {learning_rat: 1}\n"), "did you mean 'learning_rate'");
  expect_bad_input("train " + write("data.yaml", "data: {train: {file: " + file("none.json.gz") + "}}\n"), "no such episode set");
  expect_bad_input("eval " + write("junk.ckpt", "junk"), "junk.ckpt");
  expect_bad_input("leaderboard " + write("junk.json", "{}"), "junk.json");
  expect_bad_input("eval random --episodes " + write("bad.json", "{\"episodes\": [{\"episode_id\": \"0\"}]}"), "bad.json");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,nan --out " + file("x.wav"), "--listener");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --rate 100 --out " + file("x.wav"), "sample_rate_hz");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --set raya=3 --out " + file("x.wav"), "did you mean 'rays'");
  EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
}

// O-1 through the command line: r = 2.765863 m in SHOE-1 (ORACLES' z is up, ours is y): amplitude 0.0287713, delay 8.06374 ms at c = 343.2 / 343 of it.
TEST_F(Cli, RirWritesSoundAndMetrics) {
  const Outcome outcome = earshot("rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --channels mono --set air_absorption=off --components --seed 5 --out " + file("r.wav") +
                                  " --metrics " + file("r.json"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto json = nlohmann::json::parse(read("r.json"));
  EXPECT_NEAR(json.at("direct_amplitude").get<double>(), 0.0287713, 1e-4);
  EXPECT_NEAR(json.at("direct_delay_s").get<double>(), 2.765863 / 343.2, 1e-6);
  EXPECT_EQ(json.at("seed").get<int>(), 5);
  EXPECT_EQ(json.at("energy").at("rt60_s").size(), json.at("bands_hz").size());
  for (const char* part : {"r.wav", "r.direct.wav", "r.early.wav", "r.late.wav"}) EXPECT_TRUE(std::filesystem::exists(file(part))) << part;

  const std::string first = read("r.wav");
  ASSERT_EQ(earshot("rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --channels mono --set air_absorption=off --seed 5 --set threads=2 --out " + file("r.wav")).exit_code, 0);
  EXPECT_EQ(read("r.wav"), first) << "same seed, other thread count: same bytes";
}

TEST_F(Cli, WalkIsAsLongAsItsPosesAndNeverSilent) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n1.5,3,1.5,3,90\n");
  const Outcome outcome = earshot("walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") + " --source 4,1.5,1 --sound synth:noise --set rays=16 --out " + file("w.wav"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_GE(read("w.wav").size(), static_cast<std::size_t>(1.5 * 16000 * 2 * 4));
  expect_bad_input("walk shoebox:5x3x4@0.3 --poses " + write("back.csv", "1,0,0,0,0\n0,0,0,0,0\n") + " --source 4,1.5,1 --sound synth:noise --out " + file("v.wav"), "time does not rise");
}

TEST_F(Cli, SceneReportIsJson) {
  ASSERT_EQ(earshot("scene house:4,rooms=2,area_m2=24 --explain --json " + file("s.json")).exit_code, 0);
  const auto json = nlohmann::json::parse(read("s.json"));
  EXPECT_GT(json.at("ray_efficiency").get<double>(), 0.999);
  EXPECT_GT(json.at("navigable_area_m2").get<double>(), 10.0);
  EXPECT_LT(json.at("navigable_area_m2").get<double>(), 24.0);
}

}  // namespace
