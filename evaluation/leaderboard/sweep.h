// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/results/result.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Several variants of one run config, each trained with several seeds.
struct SweepConfig {
  std::string name;                   ///< default: of the file
  std::string out;                    ///< folder; default: runs/sweeps/NAME
  std::string config;                 ///< run config that all start from
  std::vector<std::uint64_t> seeds;   ///< at least one, each once
  std::vector<std::string> set = {};  ///< key=value for all
  struct Variant {
    std::string name;  ///< letters, digits, '_', '-' and '.'
    std::vector<std::string> overrides;
  };
  std::vector<Variant> runs;  ///< at least one
  /// key=value over a finished run's own config for its evaluation on data.eval; none: runs are not evaluated
  std::optional<std::vector<std::string>> evaluate = {};
};
/// Keys: name, out, config, seeds, set, runs{NAME: [key=value, ...]}, evaluate[key=value, ...].  Throws InputError: missing, unknown or
/// wrong keys, and whatever load_run_config finds wrong with a variant.
SweepConfig load_sweep(const std::filesystem::path& path);
/// Reads the keys above over `sweep`, whose name must be set.  Throws InputError.
void read(ConfigReader& reader, SweepConfig& sweep);

/// One training of a sweep.
struct SweepRun {
  std::string variant;
  std::uint64_t seed = 0;
  std::filesystem::path folder;        ///< its `out`
  std::vector<std::string> overrides;  ///< all of them, seed and out included
  RunConfig config;
  RunConfig evaluated = {};  ///< with the changes of SweepConfig::evaluate; the same where there are none
};
/// Variants in the order of the file, seeds within each.
std::vector<SweepRun> runs_of(const SweepConfig& sweep);

/// Outcome of the run.
struct SweepCurve {
  std::string variant;
  std::uint64_t seed = 0;
  bool finished = false;
  std::vector<CurvePoint> points;
  std::optional<double> held_out_success = {}, held_out_spl = {};  ///< where it was evaluated
};

/// A metric of a variant over its finished seeds: the mean over the last tenth of each one's steps, then over seeds, with Student's
/// interval.
struct SweepRow {
  std::string variant;
  std::size_t finished = 0, seeds = 0;
  Estimate success, spl, reward;
  std::size_t evaluated = 0;
  Estimate held_out_success, held_out_spl;  ///< NaN where evaluated is 0
  double env_steps = 0, minutes = 0;        ///< means
};
std::vector<SweepRow> sweep_rows(const std::vector<SweepCurve>& curves);
/// As a table for a terminal; as JSON with a schema_version; as a drawing: success, SPL and reward over steps, the mean of the seeds and a
/// band from the lowest to the highest; as a page with both.  Self-contained.
std::string sweep_text(const std::vector<SweepRow>& rows);
std::string sweep_json(const SweepConfig& sweep, const std::vector<SweepCurve>& curves);
std::string sweep_svg(const SweepConfig& sweep, const std::vector<SweepCurve>& curves);
std::string sweep_html(const SweepConfig& sweep, const std::vector<SweepCurve>& curves);

}  // namespace earshot
