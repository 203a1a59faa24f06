// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "bench/measure/bench_report.h"

namespace earshot {

struct RirBenchOptions {
  bool quick = false;  ///< one small scene, few poses: for tests of the command, not for numbers
  int repeats = 5;
  int poses = 24;                 ///< at which errors are measured
  int error_fields = 6;           ///< of as many seeds; the first is the one that is timed
  double reference_seconds = 60;  ///< per scene, for the paths that check the truth
  /// SCENEs in place of the usual ones.  Their truth are bidirectional paths themselves, at `path_poses` poses, heard with other carriers.
  std::vector<std::string> scenes;
  int path_poses = 12;
};

/// Question: how many impulse responses per second does one thread render, how wrong are they, and where does the time go?  Prints a table
/// of stages per scene as it goes.  Names and units: docs/reference/json_output.md, section 5.
BenchReport bench_rir(const RirBenchOptions& options);

}  // namespace earshot
