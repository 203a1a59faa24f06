// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "evaluation/leaderboard/benchmark.h"

namespace earshot {

/// The env in which a policy runs on a benchmark.  The benchmark sets all sensor settings and the behaviour of the world; the policy's
/// config only selects the sensors.  benchmark_env: that of the benchmark, as this machine runs it.  where: the
/// policy's file.  Throws InputError: a sensor outside all tracks, a sensor setting that differs from the benchmark's, or no sound sensor;
/// with `anything` such a policy is taken with the sensors of its own config.
EnvConfig env_for_policy(const Benchmark& benchmark, const EnvConfig& benchmark_env, const EnvConfig& policy_env, const std::string& where,
                         bool anything);

/// Keys, other than sensors, in which the training of the policy differs from the benchmark: "sound_gain", ...
std::vector<std::string> changed_in_training(const EnvConfig& benchmark_env, const EnvConfig& policy_env);

/// Where a result stands by what it says of itself; the board decides what it rests on.  Throws InputError that names the key in which its
/// environment differs from the benchmark's, or the sensor that no track has, unless it asked for the track kAnything.
Standing standing_of(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark);

/// Evidence that an agent chose its actions.
enum class Evidence { actions, run_by_board, private_set };
/// Notes it in the standing; actions alone are never ranked.
void note_evidence(Standing& standing, Evidence evidence);

}  // namespace earshot
