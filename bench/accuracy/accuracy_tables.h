// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/accuracy/accuracy_study.h"

namespace earshot {

/// Tables as Markdown: the scenes and their truth; quality modes laid out as Table 1 of the SoundSpaces 2.0 paper, its rows quoted; the
/// presets scene by scene, per octave, apart into bias and deviation, and in just-noticeable differences; every sweep; cost against size;
/// other engines.
std::string accuracy_markdown(const AccuracyStudy& study);

// parts of it
std::string preset_scenes_table(const AccuracyStudy& study);
std::string bias_table(const AccuracyStudy& study);
std::string octave_table(const AccuracyStudy& study);
std::string noticeable_table(const AccuracyStudy& study);

/// Absolute errors of a preset in just-noticeable differences, all scenes together that are part of the means.
struct NoticeableErrors {
  double p50 = 0, p95 = 0, within_pct = 0;  ///< within: of values, not above one difference
  std::size_t count = 0;
};
NoticeableErrors noticeable_errors(const AccuracyStudy& study, const std::string& preset, ErrorKind kind);
/// Values in the unit of files over `noticeable`.
NoticeableErrors count_noticeable(std::vector<double> sizes, double noticeable);

/// Presets in the order of the study, each once.
std::vector<std::string> presets_of(const AccuracyStudy& study);

}  // namespace earshot
