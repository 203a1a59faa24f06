// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "evaluation/results/evaluator.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

/// A run that takes seconds: one small house, tiny images and network.
std::string tiny_yaml(const std::filesystem::path& folder) {
  return "name: tiny\nseed: 3\nenvs_per_worker: 3\nrollout_steps: 8\ncheckpoint_every: 2\neval_envs: 2\nout: " + folder.string() +
         "\nenv:\n  task: {max_steps: 12}\n  observation: {camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, rir_length_s: "
         "0.1, early_order: 1}\n"
         "policy: {hidden_size: 16, visual_features: 16, audio_features: 16, conv_channels: 4}\n"
         "ppo: {learning_rate: 1.0e-3, epochs: 2, minibatches: 2}\n"
         "data:\n  train: {file: " +
         (folder / "train.json.gz").string() +
         ", scenes: [\"house:5,rooms=2,area_m2=20\"], episodes_per_scene: 12, sounds: [\"synth:telephone\", \"synth:bird\"], filter: "
         "{min_geodesic_m: 1, min_ratio: 1}}\n"
         "  eval: {file: " +
         (folder / "eval.json.gz").string() +
         ", scenes: [\"house:6,rooms=2,area_m2=20\"], episodes_per_scene: 5, sounds: [\"synth:alarm\"], filter: {min_geodesic_m: 1, "
         "min_ratio: 1}}\n";
}

class TrainLoop : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("earshot_train_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    yaml_ = tiny_yaml(folder_);
    const RunConfig config = parse_run_config(yaml_, "tiny", {});
    generate_data(config.train, config.env);
    generate_data(config.eval, config.env);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  /// Trains for `updates` updates in all and returns the last checkpoint.
  Checkpoint run(const std::string& out, int updates, const std::filesystem::path& resume = {}) {
    const std::uint64_t steps = static_cast<std::uint64_t>(updates) * 3 * 8;
    const std::vector<std::string> overrides{"out=" + (folder_ / out).string(), "total_steps=" + std::to_string(steps)};
    const RunConfig config = parse_run_config(yaml_, "tiny", overrides);
    const auto worker = make_single_worker();
    const TrainReport report = train(config, *worker, {.resume = resume});
    EXPECT_EQ(report.env_steps, steps);
    return load_checkpoint(report.checkpoint);
  }

  static void expect_equal(const std::map<std::string, torch::Tensor>& a, const std::map<std::string, torch::Tensor>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (const auto& [name, tensor] : a) EXPECT_TRUE(torch::equal(tensor, b.at(name))) << name;
  }

  std::filesystem::path folder_;
  std::string yaml_;
};

// The unbroken run and the one that stopped in the middle of its episodes and went on: every weight, Adam moment, hidden state and env
// cursor, bit for bit.
TEST_F(TrainLoop, ResumeGivesTheBitsOfTheUnbrokenRun) {
  const Checkpoint unbroken = run("unbroken", 5);
  run("first", 3);
  const Checkpoint resumed = run("second", 5, folder_ / "first/checkpoints/last.ckpt");
  EXPECT_EQ(resumed.update, 5u);
  expect_equal(unbroken.weights, resumed.weights);
  expect_equal(unbroken.optimizer, resumed.optimizer);
  EXPECT_EQ(unbroken.env_states, resumed.env_states);
  EXPECT_TRUE(torch::equal(unbroken.hidden.at(0), resumed.hidden.at(0)));
  EXPECT_TRUE(torch::equal(unbroken.not_done.at(0), resumed.not_done.at(0)));
}

// The same with all that guides a policy, and with halves of the batch in the background.
TEST_F(TrainLoop, ResumeGivesTheBitsOfTheUnbrokenGuidedRun) {
  const std::string last_size = "conv_channels: 4";
  yaml_.replace(yaml_.find(last_size), last_size.size(), "conv_channels: 4, guided_critic: true, goal_heads: true, normalize_values: true");
  yaml_ += "overlap: true\nguidance: {imitation: 1, imitation_until: 0.9, oracle: 0.7, oracle_until: 0.9, goal: 0.2}\n";
  const Checkpoint unbroken = run("unbroken", 5);
  const Checkpoint middle = load_checkpoint(folder_ / "unbroken/checkpoints/update_000002.ckpt");
  EXPECT_GT(middle.oracle_acted.at(0).sum().item<double>(), 0);  // in the middle of an episode that the oracle began
  const Checkpoint resumed = run("second", 5, folder_ / "unbroken/checkpoints/update_000002.ckpt");
  expect_equal(unbroken.weights, resumed.weights);
  expect_equal(unbroken.optimizer, resumed.optimizer);
  EXPECT_EQ(unbroken.env_states, resumed.env_states);
  EXPECT_TRUE(torch::equal(unbroken.hidden.at(0), resumed.hidden.at(0)));
  EXPECT_TRUE(torch::equal(unbroken.oracle_acted.at(0), resumed.oracle_acted.at(0)));
  EXPECT_EQ(unbroken.episode_window, resumed.episode_window);
  EXPECT_NE(unbroken.weights.at("value_deviation").item<float>(), 1.f);
}

// A schedule of minutes is over when the minutes of all sittings are.
TEST_F(TrainLoop, MinutesCountOverAllSittings) {
  const auto sitting = [&](const std::string& out, const std::filesystem::path& resume) {
    const RunConfig config = parse_run_config(
        yaml_, "tiny", {"out=" + (folder_ / out).string(), "schedule=minutes", "max_minutes=0.02", "ppo.linear_learning_rate_decay=true"});
    const auto worker = make_single_worker();
    return train(config, *worker, {.resume = resume});
  };
  const TrainReport first = sitting("minutes", {});
  EXPECT_GT(first.updates, 0u);
  const Checkpoint end = load_checkpoint(first.checkpoint);
  EXPECT_GE(end.elapsed_s, 1.2);
  const TrainReport second = sitting("minutes_second", first.checkpoint);
  EXPECT_EQ(second.env_steps, first.env_steps);
}

TEST_F(TrainLoop, SameSeedSameBitsAndAnotherSeedOthers) {
  const Checkpoint a = run("a", 2), b = run("b", 2);
  expect_equal(a.weights, b.weights);
  yaml_ += "\n";
  yaml_.replace(yaml_.find("seed: 3"), 7, "seed: 4");
  const Checkpoint c = run("c", 2);
  EXPECT_FALSE(torch::equal(a.weights.begin()->second, c.weights.begin()->second));
}

TEST_F(TrainLoop, EvaluationRunsEveryEpisodeOnceAndRepeats) {
  run("eval", 2);
  EvaluationConfig evaluation;
  evaluation.episodes = (folder_ / "eval.json.gz").string();
  evaluation.num_envs = 2;
  evaluation.threads = 1;
  const auto path = folder_ / "eval/checkpoints/last.ckpt";
  const EvaluationResult first = evaluate_checkpoint(path, evaluation, {});
  evaluation.threads = 2;
  const EvaluationResult second = evaluate_checkpoint(path, evaluation, {});
  ASSERT_EQ(first.episodes.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(first.episodes[i].id, std::to_string(i));
    EXPECT_FALSE(first.episodes[i].actions.empty());
    EXPECT_EQ(first.episodes[i].actions, second.episodes[i].actions) << i;
  }
  EXPECT_EQ(first.policy_hash, second.policy_hash);
}

}  // namespace
}  // namespace earshot
