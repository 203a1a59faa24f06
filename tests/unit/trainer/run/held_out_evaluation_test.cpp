// SPDX-License-Identifier: Apache-2.0
// The evaluator of a run against `evaluate_checkpoint`, on any number of workers.
#include "evaluation/results/held_out_evaluation.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/results/evaluator.h"
#include "policy/torch_threads.h"
#include "sim/base/files.h"
#include "tests/support/workers/script_modules.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

struct PartIsIn : std::exception {};

/// One worker of several that are run one after the other: its part is kept, and only the last one gets them all.
class OneAfterTheOther : public Collective {
 public:
  OneAfterTheOther(std::vector<std::string>& parts, int rank) : parts_(parts), rank_(rank) {}
  [[nodiscard]] WorkerIdentity identity() const override { return {rank_, static_cast<int>(parts_.size())}; }
  void all_reduce_sum(std::span<float>) override {}
  void all_reduce_sum(std::span<double>) override {}
  void broadcast(std::span<std::byte>) override {}
  void barrier() override {}
  std::vector<std::string> all_gather(const std::string& bytes) override {
    parts_[static_cast<std::size_t>(rank_)] = bytes;
    if (rank_ + 1 < static_cast<int>(parts_.size())) throw PartIsIn();
    return parts_;
  }
  void note_progress() override { ++steps; }

  int steps = 0;

 private:
  std::vector<std::string>& parts_;
  int rank_;
};

class HeldOutEvaluationTest : public testing::Test {
 protected:
  HeldOutEvaluationTest() {
    use_one_torch_thread();
    config_ = parse_run_config(
        fmt::format("eval_envs: 4\nout: {0}/run\nenv: {{task: {{max_steps: 15, success_radius_m: 2}}, observation: {{depth: false, camera: "
                    "{{width_px: 40, "
                    "height_px: 40}}}}, acoustics: {{rays: 4, rir_length_s: 0.1, early_order: 0}}}}\n"
                    "policy: {{hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}}\nheld_out: {{every_updates: 1}}\n"
                    "data: {{held_out: {{file: {0}/held_out.json, scenes: [\"shoebox:7x3x4@0.3\", \"shoebox:5x3x4@0.3\", "
                    "\"shoebox:4x3x7@0.3\", \"shoebox:4x3x6@0.3\", \"shoebox:4.5x3x6@0.3\", \"shoebox:5x3x5@0.3\"], episodes_per_scene: 5, "
                    "sounds: [\"synth:noise\"], filter: {{min_geodesic_m: 1, min_ratio: 1}}}}}}\n",
                    folder_.path().string()),
        "held out", {});
    generate_data(config_.held_out_data, config_.env);
  }
  [[nodiscard]] HeldOutScores evaluate(const PolicyNetwork& policy, int workers) const {
    std::vector<std::string> parts(static_cast<std::size_t>(workers));
    for (int rank = 0;; ++rank) {
      const auto evaluator = make_held_out_evaluator(config_);
      OneAfterTheOther collective(parts, rank);
      try {
        const auto scores = evaluator->evaluate(policy, collective);
        EXPECT_TRUE(scores.has_value());
        return scores.value_or(HeldOutScores{});
      } catch (const PartIsIn&) {
        EXPECT_GT(collective.steps, 0) << "the others must be able to tell that it is not stuck";
      }
    }
  }

  PrivateTestFolder folder_;
  RunConfig config_;
};

TEST_F(HeldOutEvaluationTest, AnyNumberOfWorkersHasTheScoresOfEval) {
  const auto module = folder_.path() / "net.pt";
  write_file_atomically(module, *file_like(pointgoal_policy(8), kHearingSource));
  for (std::uint64_t seed = 1; seed < 4; ++seed) {
    config_.policy.seed = seed;
    config_.policy.module = seed < 3 ? "" : module.string();
    const PolicyNetwork policy = make_policy(config_.env.observation, config_.policy);
    Checkpoint checkpoint;
    checkpoint.config_yaml = config_text(config_);
    checkpoint.architecture = policy->architecture();
    checkpoint.weights = weights_of(policy);
    checkpoint.module = policy->module_file();
    const auto file = folder_.path() / "policy.ckpt";
    save_checkpoint(checkpoint, file);
    EvaluationConfig evaluation{.episodes = config_.held_out_data.file, .num_envs = config_.eval_envs};
    evaluation.actions = ActionChoice::argmax;
    const EvaluationResult argmax = evaluate_checkpoint(file, evaluation, {});
    evaluation.actions = ActionChoice::sample;
    const EvaluationResult sample = evaluate_checkpoint(file, evaluation, {});
    EXPECT_NE(sample.success().mean, 0) << "nothing to compare";
    std::uint64_t steps = 0;
    for (const EvaluationResult* result : {&argmax, &sample})
      for (const auto& row : result->episodes) steps += static_cast<std::uint64_t>(row.metrics.steps);
    const auto expect_equal = [](const HeldOutEstimate& one, const Estimate& other) {
      EXPECT_EQ(one, (HeldOutEstimate{other.mean, other.low, other.high}));
    };
    for (const int workers : {1, 2, 3, 7, 9}) {  // of eight rounds: one worker has nothing to do
      const HeldOutScores scores = evaluate(policy, workers);
      expect_equal(scores.argmax.success, argmax.success());
      expect_equal(scores.argmax.spl, argmax.spl());
      expect_equal(scores.sample.success, sample.success());
      expect_equal(scores.sample.spl, sample.spl());
      EXPECT_EQ(scores.env_steps, steps) << workers;
      EXPECT_GT(scores.seconds, 0);
    }
  }
}

TEST_F(HeldOutEvaluationTest, WhatDecidesScoresIsTheirIdentity) {
  const std::string identity = make_held_out_evaluator(config_)->identity();
  EXPECT_EQ(make_held_out_evaluator(config_)->identity(), identity);
  RunConfig other = config_;
  other.eval_envs = 5;
  EXPECT_NE(make_held_out_evaluator(other)->identity(), identity);
  other = config_;
  other.eval_actions = ActionChoice::argmax;
  EXPECT_NE(make_held_out_evaluator(other)->identity(), identity);
  other = config_;
  other.held_out_data.seed = 5;
  generate_data(other.held_out_data, other.env);
  EXPECT_NE(make_held_out_evaluator(other)->identity(), identity);
  other.held_out.every_updates = 0;
  EXPECT_EQ(make_held_out_evaluator(other), nullptr);
}

}  // namespace
}  // namespace earshot
