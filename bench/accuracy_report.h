#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "bench/accuracy_study.h"
#include "bench/bench_report.h"

namespace earshot {

/// One line per scene and mode: times, then mean, rms, 95th percentile, standard error and count of every error.
std::string accuracy_csv(const AccuracyStudy& study);
/// Tables as Markdown: the scenes and their truth; quality modes laid out as Table 1 of the SoundSpaces 2.0 paper, its rows quoted; every
/// sweep.
std::string accuracy_markdown(const AccuracyStudy& study);

/// Mean over scenes of one mode, in the unit of files; scenes without a value are left out.
struct ModeMean {
  double mean = 0, standard_error = 0;  ///< error: of the scenes' own standard errors together
  int scenes = 0, missing = 0;
};
ModeMean mean_over_scenes(const AccuracyStudy& study, const std::string& sweep, const std::string& value, ErrorKind kind);
/// Mean over scenes of the milliseconds per RIR with n of them per source; of the scenes that have a value of `kind`, if it is given.
double mean_shared_ms(const AccuracyStudy& study, const std::string& sweep, const std::string& value, int n,
                      std::optional<ErrorKind> kind = {});

/// accuracy.csv, accuracy_tables.md, accuracy_pareto.svg, accuracy_scenes.svg, accuracy_sweeps.svg.
void write_accuracy_files(const AccuracyStudy& study, const std::filesystem::path& folder);
/// The presets, for --json.
BenchReport accuracy_bench_report(const AccuracyStudy& study);

}  // namespace earshot
