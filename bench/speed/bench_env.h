// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/measure/bench_report.h"

namespace earshot {

struct EnvBenchOptions {
  bool quick = false;
  int repeats = 5;
  double seconds = 3;  ///< per repeat
  std::string scene = "house:1,rooms=3";
  int envs = 8, width_px = 128, height_px = 128;
  int agents = 1;                                        ///< in each env
  bool agent_sounds = false;                             ///< which each of them makes
  bool walk = false;                                     ///< random walks without an end in place of the oracle
  int threads = 0;                                       ///< 0: one, and in a row of its own two
  std::string renderer = "embree", egl_device = "auto";  ///< as the keys of an environment's observation
  bool field = false;     ///< late sound from source fields, ten goals shared by all episodes; otherwise rays of the preset at each pose
  bool autotune = false;  ///< sweeps envs and threads instead
};

/// Question: how many agent steps per second does a machine give, and which stage takes them?  Agents that walk to their goals in one
/// scene, ends of episodes included: with all senses, without sound, without picture, and bare (neither); percentiles of the time of a
/// batch step, memory, and the rays per second of Embree alone in the same run, so that results are ratios.  autotune: steps per second
/// over envs and threads, and the best of them.  Names and units: docs/reference/json_output.md, section 5.  Throws InputError.
BenchReport bench_env(const EnvBenchOptions& options);

}  // namespace earshot
