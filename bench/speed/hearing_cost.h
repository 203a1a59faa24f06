// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "bench/measure/bench_report.h"

namespace earshot {

struct HearingCostOptions {
  bool quick = false;
  std::vector<std::string> scenes = {};  ///< SCENEs; empty: a house of quick.yaml and the large house of bench rir
  double truth_seconds = 60;             ///< per scene, for the converged reference
};

/// Question: cost and accuracy of 16, 64 and 256 rays per pose, and of the source field, for an agent.  Preset `fast` with the length
/// that the scene asks for.  Per scene and mode: environment steps per second of eight agents, milliseconds per response and per source,
/// the error of T20 of the RIR that agents hear, and of the energy response, against a converged reference of bidirectional paths, and the
/// log-spectral distance of the observed spectrogram to the one from that reference.
struct HearingCost {
  BenchReport report;
  std::string markdown;  ///< the table of docs/evidence/hearing_cost.md
};
HearingCost bench_hearing(const HearingCostOptions& options);

}  // namespace earshot
