// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {

struct Outcome {
  int exit_code = -1;
  std::string text;
};

/// A training of seconds, as a user starts it.
class TrainCli : public testing::Test {
 protected:
  TrainCli() {
    write_text(
        path("tiny.yaml"),
        "name: tiny\nseed: 3\nenvs_per_worker: 2\nrollout_steps: 4\ncheckpoint_every: 1\nkeep: 2\ntotal_steps: 32\neval_envs: 2\nout: " +
            path("run") +
            "\nenv:\n  task: {max_steps: 12}\n  observation: {depth: false, camera: {width_px: 40, height_px: 40}}\n"
            "  acoustics: {rays: 4, rir_length_s: 0.1, early_order: 0}\n"
            "policy: {hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}\n"
            "data:\n" +
            data("train", 6) + data("eval", 2));
  }
  [[nodiscard]] std::string data(const std::string& section, int count) const {
    return "  " + section + ": {file: " + path(section + ".json.gz") +
           ", scenes: [\"shoebox:6x3x5@0.3\"], episodes_per_scene: " + std::to_string(count) +
           ", sounds: [\"synth:noise\"], filter: {min_geodesic_m: 1, min_ratio: 1}}\n";
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  /// Runs the program; its output and errors together.
  [[nodiscard]] Outcome earshot(const std::string& arguments) const {
    const int status = std::system((earshot::earshot_program().string() + " " + arguments + " >" + path("output") + " 2>&1").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  void expect_done(const std::string& arguments) const {
    const Outcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.text;
  }
  /// Exit code 2 and one line.
  void expect_refused(const std::string& arguments, const testing::Matcher<std::string>& line) const {
    const Outcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.text;
    EXPECT_THAT(outcome.text, line);
    EXPECT_EQ(std::ranges::count(outcome.text, '\n'), 1) << outcome.text;
  }
  [[nodiscard]] std::vector<std::string> checkpoints() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "run/checkpoints"))
      names.push_back(entry.path().filename());
    std::ranges::sort(names);
    return names;
  }

  TestFolder folder_{"train_cli"};
};

}  // namespace earshot
