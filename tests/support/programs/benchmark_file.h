// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "evaluation/leaderboard/benchmark.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {

/// The reason for which this is refused; empty where it is not.
inline std::string refusal(const std::function<void()>& body) {
  try {
    body();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

/// Two small generated houses to train in, two to test in, a heard and an unheard sound and one of a kind that is held out.
class BenchmarkFile : public testing::Test {
 protected:
  BenchmarkFile() {
    config_.env.task.max_steps = 60;
    config_.train.scenes = {"house:1..2,rooms=2,area_m2=24"};
    config_.train.sounds = {"synth:bird:0..2"};
    config_.eval.file = path("public.json");
    config_.eval.scenes = {"house:11..12,rooms=2,area_m2=24"};
    config_.eval.episodes_per_scene = 3;
    config_.eval.sounds = {"synth:bird:2", "synth:bird:9", "synth:noise:9"};
    config_.eval.filter = {.min_geodesic_m = 1, .min_ratio = 1};
    rules_hash_ = hash_of_rules(metric_rules(config_.env, config_.eval_envs));
    set_hash_ = "0123456789abcdef";
    section_ = "  heard_sounds: [\"synth:bird:2\"]\n  held_out_kinds: [noise]\n";
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  /// The benchmark as a file would have it.
  Benchmark load() const {
    write_text(path("tiny.yaml"), "benchmark:\n  name: tiny\n  version: 1\n  set_hash: \"" + set_hash_ + "\"\n  rules_hash: \"" +
                                      rules_hash_ + "\"\n  senses_hash: \"" + senses_hash() + "\"\n" + section_ + config_text(config_));
    return load_benchmark(path("tiny.yaml"));
  }
  /// That of the config and of the tracks that section_ says, which are the usual ones.
  [[nodiscard]] std::string senses_hash() const {
    return senses_hash_.empty() ? hash_of_senses(sensed_config(config_.env), default_tracks()) : senses_hash_;
  }
  /// The public set made, and its hash noted.
  void make_public_set() {
    static_cast<void>(refusal([&] { benchmark_set(load()); }));
    set_hash_ = hex64(load_episode_set(path("public.json")).hash);
  }
  [[nodiscard]] std::string split_refusal() const {
    return refusal([&] { check_splits(load()); });
  }

  TestFolder folder_{"benchmark"};
  RunConfig config_;
  std::string rules_hash_, set_hash_, section_, senses_hash_;
};

}  // namespace earshot
