// SPDX-License-Identifier: Apache-2.0
// Benchmarks and their splits.
#include "evaluation/leaderboard/benchmark.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "evaluation/results/evaluator.h"
#include "tests/support/programs/benchmark_file.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST_F(BenchmarkFile, FixesSetAndRules) {
  EXPECT_THAT(refusal([&] { benchmark_set(load()); }), HasSubstr("tiny 1 needs 0123456789abcdef"));
  make_public_set();
  EXPECT_EQ(benchmark_set(load()).episodes.size(), 6u);
  config_.env.task.max_steps = 61;
  EXPECT_THAT(refusal([&] { load(); }), HasSubstr("but benchmark.rules_hash is " + rules_hash_));
  config_.env.task.max_steps = 60;
  section_ = "  privat: {}\n";
  EXPECT_THAT(refusal([&] { load(); }), HasSubstr("privat"));
}

TEST_F(BenchmarkFile, WhatTestAndTrainingHaveInCommonIsRefused) {
  EXPECT_EQ(split_refusal(), "");
  config_.train.scenes = {"house:1..2,rooms=2,area_m2=24", "house:12,rooms=3,area_m2=40"};
  EXPECT_THAT(split_refusal(), HasSubstr("'house:12,rooms=2,area_m2=24' in its test set, the same as 'house:12,rooms=3,area_m2=40'"));
  // The same rooms and furniture with a finer mesh under another name: found by geometry.
  config_.train.scenes = {"house:1..2,rooms=2,area_m2=24", path("copy.obj")};
  const Scene house = load_scene("house:12,rooms=2,area_m2=24");
  std::string obj;
  for (const glm::vec3 v : house.mesh().vertices) obj += fmt::format("v {} {} {}\n", v.x + 5, v.y, v.z - 3);
  for (const glm::uvec3 t : house.mesh().triangles) obj += fmt::format("f {} {} {}\n", t.x + 1, t.y + 1, t.z + 1);
  write_text(path("copy.obj"), obj);
  EXPECT_THAT(split_refusal(), AllOf(HasSubstr("a near-duplicate of"), HasSubstr("copy.obj")));
}

TEST_F(BenchmarkFile, SoundsAreNewUnlessTheyAreCalledHeard) {
  section_ = "";
  EXPECT_THAT(split_refusal(), HasSubstr("'synth:bird:2' in its test set"));
  section_ = "  heard_sounds: [\"synth:bird:2\", \"synth:bird:9\"]\n";
  EXPECT_THAT(split_refusal(), HasSubstr("'synth:bird:9' in benchmark.heard_sounds, but training and test sets do not both contain it"));
  section_ = "  heard_sounds: [\"synth:bird:2\"]\n  held_out_kinds: [noise, bird]\n";
  EXPECT_THAT(split_refusal(), HasSubstr("'synth:bird:0' in data.train, which belongs to 'bird'"));
  section_ = "  heard_sounds: [\"synth:bird:2\"]\n  held_out_kinds: [noise, click]\n";
  EXPECT_THAT(split_refusal(), HasSubstr("no sound of kind 'click'"));
}

// What no number follows from is refused by the benchmark: the seed of sampled actions, what a sound was to the training; and what does not
// belong on a board: the first episodes of the set alone.
TEST_F(BenchmarkFile, ResultsOfOtherSeedsAndNoveltiesAreRefused) {
  config_.env.observation.spectrogram = config_.env.observation.depth = false;
  config_.env.observation.pointgoal = true;
  rules_hash_ = hash_of_rules(metric_rules(config_.env, config_.eval_envs));
  make_public_set();
  const Benchmark benchmark = load();
  const EpisodeSet set = benchmark_set(benchmark);
  EvaluationConfig evaluation;
  evaluation.episodes = path("public.json");
  evaluation.num_envs = benchmark.run.eval_envs;
  evaluation.threads = 1;
  const EvaluationResult result = evaluate_baseline(Baseline::oracle, "oracle", config_.env, evaluation);
  const auto refused = [&](const EvaluationResult& forged) {
    return refusal([&] {
      save_result(forged, path("result.json"));  // with a checksum that fits
      verify_for_benchmark(load_result(path("result.json")), "result.json", benchmark, set, {.threads = 1});
    });
  };
  EXPECT_EQ(refused(result), "");
  EvaluationResult forged = result;
  forged.seed = 7;
  EXPECT_THAT(refused(forged), HasSubstr("was run with seed 7, but tiny needs 0"));
  forged = result;
  for (auto& row : forged.episodes) row.novelty = "unheard kind";
  EXPECT_THAT(refused(forged), HasSubstr("as 'unheard kind' relative to training; by the benchmark it is"));
  evaluation.max_episodes = 3;
  EXPECT_THAT(refused(evaluate_baseline(Baseline::oracle, "oracle", config_.env, evaluation)),
              HasSubstr("is partial: it covers 3 of the 6"));
}

}  // namespace
}  // namespace earshot
