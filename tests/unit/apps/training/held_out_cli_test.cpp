// SPDX-License-Identifier: Apache-2.0
// Runs that evaluate themselves on held-out episodes, as a user starts them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <map>
#include <optional>
#include <set>
#include <thread>

#include "evaluation/results/result.h"
#include "sim/base/random.h"
#include "tests/support/programs/run_cli.h"
#include "trainer/curves/event_log.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class HeldOutCli : public RunCli {
 protected:
  HeldOutCli() {
    std::string text = read_file(config_);
    const std::string steps = "max_steps: 12";
    text.replace(text.find(steps), steps.size(), steps + ", success_radius_m: 2");  // which chance reaches in some episodes
    write_text(config_, text + "  held_out: {file: " + path("held_out.json.gz") +
                            ", scenes: [\"shoebox:7x3x4@0.3\", \"shoebox:4x3x7@0.3\", \"shoebox:5x3x4@0.3\", \"shoebox:4.5x3x5.5@0.3\", "
                            "\"shoebox:5.5x3x6.5@0.3\"], episodes_per_scene: 5, sounds: [\"synth:noise\"], filter: {min_geodesic_m: 1, "
                            "min_ratio: 1}}\nheld_out: {max_fraction: 1}\n");
  }
  /// Values of the evaluations in the curve of a run, by update.
  [[nodiscard]] std::map<std::uint64_t, std::map<std::string, double>> evaluations(const std::string& run = "run") const {
    std::map<std::uint64_t, std::map<std::string, double>> found;
    for (const CurvePoint& point : read_event_log(path(run + "/events.jsonl")))
      if (is_of_held_out(point)) {
        EXPECT_FALSE(found.contains(point.update)) << "update " << point.update << " twice";
        for (const auto& [name, value] : point.values)
          if (name != "held_out/evaluate_s" && name != "held_out/time_fraction") found[point.update][name] = value;
      }
    return found;
  }
  [[nodiscard]] HeldOutState state_of(const std::string& file) const {
    HeldOutState state = load_checkpoint_metadata(path(file)).held_out.value_or(HeldOutState{});
    state.seconds = state.last_seconds = 0;  // all but these is the same on every machine
    return state;
  }
  void expect_same_run(const std::string& one, const std::string& other) const {
    EXPECT_EQ(bits_of(one + "/checkpoints/last.ckpt"), bits_of(other + "/checkpoints/last.ckpt"));
    EXPECT_EQ(state_of(one + "/checkpoints/last.ckpt"), state_of(other + "/checkpoints/last.ckpt"));
    EXPECT_EQ(evaluations(one), evaluations(other));
    EXPECT_EQ(bits_of(one + "/checkpoints/best.ckpt"), bits_of(other + "/checkpoints/best.ckpt"));
  }
};

// The best one by another reading of the curve; and what `eval` says of its checkpoint is what the curve says, to the last bit.
TEST_F(HeldOutCli, TheBestCheckpointIsTheBestOfTheCurve) {
  for (const std::string actions : {"sample", "argmax"}) {
    expect_done("train " + config_ + " held_out.every_updates=2 total_steps=96 ppo.learning_rate=0.02 --overwrite eval_actions=" + actions);
    const auto curve = evaluations();
    std::vector<std::uint64_t> updates;
    std::uint64_t best = 0;
    std::set<double> different;
    for (const auto& [update, values] : curve) {
      updates.push_back(update);
      const auto score = [&](std::uint64_t at) {
        return std::pair(curve.at(at).at("held_out/" + actions + "_success"), curve.at(at).at("held_out/" + actions + "_spl"));
      };
      if (best == 0 || score(update) > score(best)) best = update;
      different.insert(score(update).first);
      EXPECT_EQ(values.at("held_out/best_update"), static_cast<double>(best));
    }
    EXPECT_EQ(updates, (std::vector<std::uint64_t>{2, 4, 6, 8, 10, 12}));
    EXPECT_EQ(update_of("run/checkpoints/best.ckpt"), best) << actions;
    EXPECT_GT(different.size(), actions == "sample" ? 1u : 0u) << "nothing to choose";
    for (const std::string how : {"argmax", "sample"}) {
      expect_done("eval " + path("run/checkpoints/best.ckpt") + " --episodes " + path("held_out.json.gz") + " --" + how + " --out " +
                  path("result.json"));
      const EvaluationResult result = load_result(path("result.json"));
      EXPECT_EQ(result.episodes.size(), 25u);
      for (const auto& [name, estimate] : {std::pair("success", result.success()), std::pair("spl", result.spl())}) {
        const std::string key = "held_out/" + how + "_" + name;
        EXPECT_EQ(curve.at(best).at(key), estimate.mean) << key;
        EXPECT_EQ(curve.at(best).at(key + "_low"), estimate.low) << key;
        EXPECT_EQ(curve.at(best).at(key + "_high"), estimate.high) << key;
      }
    }
  }
}

TEST_F(HeldOutCli, PatienceEndsARunThatLearnsNoMore) {
  const std::string train = "train " + config_ + " total_steps=160 ppo.learning_rate=1e-30 held_out.every_updates=2 held_out.patience=";
  const Outcome ended = earshot(train + "2");
  EXPECT_EQ(ended.exit_code, 0) << ended.text;
  EXPECT_EQ(update_of("run/checkpoints/last.ckpt"), 6u) << "evaluated at 2, 4 and 6: two in a row are no better";
  EXPECT_EQ(update_of("run/checkpoints/best.ckpt"), 2u);
  EXPECT_THAT(ended.text, AllOf(HasSubstr("held out: 3 evaluations"), HasSubstr("best update 2"), HasSubstr("ended: no better one in 2")));
  // The same command goes on to the same end, which is here; with more patience to another.
  expect_done(train + "2 --resume " + path("run"));
  EXPECT_EQ(newest_update(), 6u);
  expect_done(train + "4 --resume " + path("run"));
  EXPECT_EQ(newest_update(), 10u);
  expect_done(train + "0 --resume " + path("run"));
  EXPECT_EQ(newest_update(), 20u);
  EXPECT_EQ(update_of("run/checkpoints/best.ckpt"), 2u);
}

// Whether it is evaluated, and on how many threads, is nothing to the training.
TEST_F(HeldOutCli, TheTrainingHasTheSameBits) {
  for (const std::string workers : {"1", "2"}) {
    const std::string train = "train " + config_ + " --overwrite total_steps=96 --workers " + workers;
    expect_done(train + " out=" + path("off"));
    expect_done(train + " out=" + path("on") + " held_out.every_updates=2");
    expect_done(train + " out=" + path("threads") + " held_out.every_updates=2 env.threads=3");
    EXPECT_EQ(bits_of("off/checkpoints/last.ckpt"), bits_of("on/checkpoints/last.ckpt")) << workers;
    expect_same_run("on", "threads");
    EXPECT_EQ(evaluations("on").size(), workers == "1" ? 6u : 3u);
    EXPECT_TRUE(evaluations("off").empty());
  }
}

// Stopped by its steps at any update, before or behind an evaluation, or gone on with from any checkpoint.
TEST_F(HeldOutCli, AResumedRunIsTheUnbrokenOne) {
  for (const int workers : {1, 2}) {
    const RandomStream random(static_cast<std::uint64_t>(workers), Purpose::test);
    const auto train = [&](int updates, const std::string& run) {
      return "train " + config_ + " held_out.every_updates=3 held_out.max_fraction=0.95 keep=50 ppo.learning_rate=0.02 --workers " +
             std::to_string(workers) + " out=" + path(run) + " total_steps=" + std::to_string(8 * workers * updates);
    };
    expect_done(train(12, "unbroken") + " --overwrite");
    EXPECT_GE(evaluations("unbroken").size(), 2u);
    for (std::uint32_t i = 0; i < 3; ++i) {
      const int cut = 1 + static_cast<int>(random.below(11, i));
      expect_done(train(cut, "broken") + " --overwrite");
      expect_done(train(12, "broken") + " --resume " + path("broken"));
      expect_same_run("unbroken", "broken");
    }
    const auto from = 1 + random.below(11, 9);
    expect_done(train(12, "broken") + " --resume " + path("broken/checkpoints/update_" + fmt::format("{:06}", from) + ".ckpt"));
    expect_same_run("unbroken", "broken");
  }
}

// Nearly all of the time of these runs is that of evaluations.
TEST_F(HeldOutCli, ASignalBreaksAnEvaluationOffAndItIsMadeAgain) {
  const std::string common = " held_out.every_updates=1 total_steps=64 --workers 2";
  expect_done("train " + config_ + common + " out=" + path("unbroken"));
  for (std::uint32_t i = 0; i < 3; ++i) {
    const auto run = start({"held_out.every_updates=1", "total_steps=64", "--workers", "2"});
    ASSERT_TRUE(is_under_way());
    std::this_thread::sleep_for(std::chrono::milliseconds(RandomStream(i, Purpose::test, 3).below(400, 0)));
    run->signal(SIGTERM);
    const int code = run->wait();
    EXPECT_TRUE(code == 143 || code == 0) << code << run->text();
    expect_done("train " + config_ + common + " --resume " + path("run"));
    expect_same_run("unbroken", "run");
  }
}

TEST_F(HeldOutCli, ScenesOfTheTrainingAreRefusedByName) {
  const std::string train = "train " + config_ + " held_out.every_updates=2";
  const auto with = [&](const std::string& scenes) { return " --set 'data.held_out.scenes=[" + scenes + "]'"; };
  const auto refused = [&](const std::string& scenes, const testing::Matcher<std::string>& line) {
    expect_done("dataset episodes --config " + config_ + with(scenes));
    expect_refused(train + " 'data.held_out.scenes=[" + scenes + "]'", line);
    EXPECT_FALSE(std::filesystem::exists(path("run/checkpoints")));
  };
  refused("\"shoebox:7x3x4@0.3\", \"shoebox:6x3x5@0.3\"",
          AllOf(HasSubstr(path("held_out.json.gz")), HasSubstr("has a scene that the run trains in: shoebox:6x3x5@0.3; leave")));
  refused("\"shoebox:6x3x5@0.9\"", HasSubstr("shoebox:6x3x5@0.9, a near-duplicate of shoebox:6x3x5@0.3 of the training set"));
  expect_refused(train + " --workers 2 'data.held_out.scenes=[\"shoebox:6x3x5@0.9\"]'", HasSubstr("near-duplicate"));
  // Of the final evaluation it is a warning.
  const std::string eval = "'data.eval.scenes=[\"shoebox:7x3x4@0.3\"]'";
  expect_done("dataset episodes --config " + config_ + " --set " + eval);
  const Outcome warned = earshot(train + " " + eval);
  EXPECT_EQ(warned.exit_code, 0) << warned.text;
  EXPECT_THAT(warned.text, HasSubstr("shares scenes with data.eval: shoebox:7x3x4@0.3; best.ckpt is chosen by them"));
}

TEST_F(HeldOutCli, WhatCannotBeEvaluatedIsRefused) {
  const std::string train = "train " + config_ + " held_out.every_updates=2";
  expect_refused(train + " data.held_out.file=" + path("absent.json.gz"),
                 AllOf(HasSubstr("absent.json.gz"), HasSubstr("dataset episodes")));
  expect_refused(train + " 'data.held_out.file=\"\"'", HasSubstr("held_out.every_updates = 2: needs data.held_out with a file"));
  expect_refused(train + " data.held_out.seed=5", HasSubstr("held_out.json.gz: was made with data.seed = 0, but the config has 5"));
  expect_refused("train " + config_ + " held_out.patience=2", HasSubstr("held_out.patience = 2: has no effect without"));
  expect_refused(train + " held_out.max_fraction=0", HasSubstr("held_out.max_fraction"));
  expect_refused(train + " held_out.every_update=2", HasSubstr("did you mean 'every_updates'"));
}

// Evaluations wait until they fit: steps of evaluations in all steps, by the curve alone.
TEST_F(HeldOutCli, TheShareOfTheStepsIsBounded) {
  expect_done("train " + config_ + " held_out.every_updates=1 held_out.max_fraction=0.5 total_steps=2000");
  double spent = 0;
  std::size_t evaluations = 0;
  for (const CurvePoint& point : read_event_log(path("run/events.jsonl"))) {
    if (!is_of_held_out(point)) continue;
    const double before = spent;
    for (const auto& [name, value] : point.values)
      if (name == "held_out/env_steps") spent += value;
    // By what the one before cost, which is not quite what this one did.
    if (before > 0) {
      EXPECT_LE(spent, 0.6 * (spent + static_cast<double>(point.env_steps)));
    }
    ++evaluations;
  }
  EXPECT_GE(evaluations, 2u);
  EXPECT_LT(evaluations, 100u);
}

}  // namespace
}  // namespace earshot
