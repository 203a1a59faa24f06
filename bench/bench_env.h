#pragma once

#include "bench/bench_report.h"

namespace earshot {

struct EnvBenchOptions {
  bool quick = false;
  int repeats = 5;
  double seconds = 3;  ///< per repeat
};

/// Question: how many agent steps per second does a machine give, and which stage takes them?  Eight agents that walk to their goals in a
/// furnished house of three rooms, ends of episodes included: with all senses on one thread and on two, without sound, without picture,
/// and bare (neither).  Names and units: docs/formats.md, section 5.4.
BenchReport bench_env(const EnvBenchOptions& options);

}  // namespace earshot
