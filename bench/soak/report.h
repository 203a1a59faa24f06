// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <filesystem>
#include <string>

#include "bench/measure/bench_report.h"
#include "bench/soak/soak.h"

namespace earshot {

struct SoakQuantile {
  const char* name;
  double fraction;
};
inline constexpr std::array<SoakQuantile, 5> kSoakQuantiles{{{"p50", 0.5}, {"p90", 0.9}, {"p99", 0.99}, {"p99.9", 0.999}, {"max", 1}}};
double quantile_of(const LogHistogram& values, const SoakQuantile& quantile);  ///< fraction 1: the largest, exact

/// A page: the run, each bound with its status, step times, kinds of scenes, and the faults with their places.
std::string soak_markdown(const SoakResult& result);
/// The same as numbers, with all samples of memory.
BenchJson soak_json(const SoakResult& result);
/// soak.md, soak.json and soak.svg in `folder`.
void write_soak_files(const SoakResult& result, const std::filesystem::path& folder);
/// What `bench soak --json` writes.
BenchReport soak_bench_report(const SoakResult& result);

}  // namespace earshot
