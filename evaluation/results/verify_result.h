// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "envs/episodes/episode_set.h"
#include "evaluation/results/metric_rules.h"
#include "evaluation/results/result.h"

namespace earshot {

struct VerifyConfig {
  int threads = 0;                               ///< 0: all cores; any number finds the same
  bool any_engine = false;                       ///< also results of other builds: their numbers must be those of this one nevertheless
  bool partial = false;                          ///< also results of the first episodes of a set
  std::string scene_root = {}, sound_root = {};  ///< as EnvConfig's
};

struct Verification {
  std::size_t episodes = 0;
  std::uint64_t steps = 0;
  bool partial = false;      ///< fewer episodes than the set has
  bool same_engine = false;  ///< of the build that wrote the result
  Standing standing = {};    ///< of verify_for_benchmark: the evidence is not recorded
  std::string toolchain;     ///< walking_toolchain() of the program that wrote it; empty if the result does not say
};

/// Walks the actions of every episode again, in geometry alone, and compares what comes out bit for bit: success, SPL, SoftSPL, SNA,
/// success when silent, distance to the goal, reward, steps, stop and collisions; and that episodes are those of the set in its order, each
/// once and whole, the summary follows from them, and the file is as it was written.  Actions prove the numbers, but not that the agent
/// chose them by hearing. where: the result's file, for messages.  set: the whole set.  rules: by which numbers are made; those of the
/// result must be the
/// same, where it has any.  Throws InputError with the first fault and its episode; if another toolchain may be the reason, the message
/// names both toolchains.  A few milliseconds an episode.
Verification verify_result(const EvaluationResult& result, const std::string& where, const EpisodeSet& set, const MetricRules& rules,
                           const VerifyConfig& config);

}  // namespace earshot
