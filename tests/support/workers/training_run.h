// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Whole runs of worker processes that train a small policy in one small room: the config, its episodes and what a run leaves on disk.
class TrainingRun : public testing::Test {
 protected:
  static constexpr int kEnvsPerWorker = 2, kRolloutSteps = 8;
  static constexpr int kCallsPerUpdate = 4;  ///< sums of a gradient: two epochs of two minibatches

  /// lines: of the run, each with its line feed.  policy, ppo: further keys, each behind a comma.
  explicit TrainingRun(const std::string& lines, const std::string& policy = "", const std::string& ppo = "")
      : yaml_("name: tiny\nseed: 3\nenvs_per_worker: 2\nrollout_steps: 8\n" + lines + "out: " + out().string() +
              "\nenv:\n  task: {max_steps: 12}\n  observation: {camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, "
              "rir_length_s: 0.1, early_order: 1}\n"
              "policy: {hidden_size: 16, visual_features: 16, audio_features: 16, conv_channels: 4" +
              policy + "}\nppo: {learning_rate: 1.0e-3, epochs: 2, minibatches: 2" + ppo +
              "}\ndata:\n  train: {file: " + (folder_.path() / "train.json.gz").string() +
              ", scenes: [\"shoebox:5x3x4@0.2\"], episodes_per_scene: 12, sounds: [\"synth:telephone\"], filter: {min_geodesic_m: 1, "
              "min_ratio: 1}}\n") {}
  void SetUp() override {
    // In a process of its own: what forks workers must not have started the threads of the simulation.
    WorkerProcesses generator(1, [&](int) {
      const RunConfig run = config_with({});
      return !generate_data(run.train, run.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }
  [[nodiscard]] RunConfig config_with(const std::vector<std::string>& overrides) const {
    return parse_run_config(yaml_, "tiny", overrides);
  }
  [[nodiscard]] std::filesystem::path out(const std::string& name = "run") const { return folder_.path() / name; }
  double last_value(const std::string& curve) {
    const CurvePoint point = read_event_log(out() / "events.jsonl").back();
    for (const auto& [key, value] : point.values)
      if (key == curve) return value;
    ADD_FAILURE() << "no curve " << curve;
    return -1;
  }
  static void expect_same_learner(const Checkpoint& first, const Checkpoint& second) {
    ASSERT_EQ(first.optimizer.size(), second.optimizer.size());
    for (const auto& [name, tensor] : first.weights) EXPECT_TRUE(torch::equal(tensor, second.weights.at(name))) << name;
    for (const auto& [name, tensor] : first.optimizer) EXPECT_TRUE(torch::equal(tensor, second.optimizer.at(name))) << name;
    EXPECT_EQ(first.env_states, second.env_states);
  }

  PrivateTestFolder folder_;
  const std::string yaml_;
};

}  // namespace earshot
