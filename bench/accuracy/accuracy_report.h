// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <limits>
#include <optional>
#include <string>

#include "bench/accuracy/accuracy_study.h"
#include "bench/measure/bench_report.h"

namespace earshot {

/// One line per scene and mode: times, then for every error mean, its standard error, signed mean, cross-validated rms and its standard
/// error, bias and its standard error, deviation, percentiles and counts (docs/reference/json_output.md).
std::string accuracy_csv(const AccuracyStudy& study);

/// Means over scenes of one mode, in the unit of files; scenes without a value are left out.
struct ModeMean {
  double mean = 0, standard_error = 0;  ///< of absolute values; error: of the scenes' own standard errors together
  double rms = 0, rms_error = 0;        ///< root of the mean over scenes of the cross-validated mean square
  double bias = 0, deviation = 0, signed_mean = 0;
  int scenes = 0, missing = 0;
};
ModeMean mean_over_scenes(const AccuracyStudy& study, const std::string& sweep, const std::string& value, ErrorKind kind, int band = -1);
/// The mean of nothing.
inline constexpr double kNoMean = std::numeric_limits<double>::quiet_NaN();
/// Responses that one source is heard in, where rates share the work for it: an episode of the task.
inline constexpr int kEpisodeSteps = 500;
/// Mean over scenes of the milliseconds per RIR with n of them per source; of the scenes that have a value of `kind`, if it is given.
double mean_shared_ms(const AccuracyStudy& study, const std::string& sweep, const std::string& value, int n,
                      std::optional<ErrorKind> kind = {});
/// Is a scene part of the means over scenes?  All but the open one.
bool is_in_means(const std::string& scene);

/// accuracy.csv, accuracy_tables.md, accuracy_pareto.svg, accuracy_scenes.svg, accuracy_sweeps.svg, accuracy_engines.svg.
void write_accuracy_files(const AccuracyStudy& study, const std::filesystem::path& folder);
/// The presets, for --json.
BenchReport accuracy_bench_report(const AccuracyStudy& study);

}  // namespace earshot
