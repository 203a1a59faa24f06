// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/accuracy/accuracy_study.h"

namespace earshot {

/// Time per RIR against errors in T20 and in the decay curve, mean over the scenes: one line per method, the presets and the original's two
/// modes marked, thresholds of hearing drawn.
std::string pareto_figure(const AccuracyStudy& study);
/// Time per RIR against error in T20, one panel per scene.
std::string scenes_figure(const AccuracyStudy& study);
/// Every other parameter against the errors that it moves, mean over the scenes.
std::string sweeps_figure(const AccuracyStudy& study);

}  // namespace earshot
