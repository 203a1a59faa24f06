// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/hearing_cost.h"

#include <fmt/format.h>

#include "bench/accuracy/study_scene.h"
#include "sim/base/process/progress.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr int kPoses = 24;
constexpr const char* kTrainingHouse = "house:1000,rooms=3,area_m2=36";

/// As presets of the study, whose environments are timed too.
std::vector<AccuracyMode> modes() {
  AcousticConfig fast = acoustic_preset("fast");
  fast.threads = 1;
  fast.rir_length_s = 0.f;
  std::vector<AccuracyMode> all;
  for (const int rays : {16, 64, 256}) {
    AcousticConfig traced = fast;
    traced.field = Switch::off;
    traced.rays = rays;
    all.push_back({.sweep = "preset", .value = fmt::format("rays{}", rays), .method = fmt::format("{} rays", rays), .config = traced});
  }
  fast.field = Switch::on;
  all.push_back({.sweep = "preset", .value = "field", .method = "source field", .config = fast});
  return all;
}

}  // namespace

HearingCost bench_hearing(const HearingCostOptions& options) {
  HearingCost result{.report = BenchReport("hearing"), .markdown = {}};
  std::vector<SceneName> scenes;
  for (const std::string& spec : options.scenes) scenes.push_back({spec, spec});
  if (scenes.empty()) scenes.push_back({"training_house", kTrainingHouse});
  if (options.scenes.empty() && !options.quick) scenes.push_back({"large_house", kLargeHouse});
  const int poses = options.quick ? 4 : kPoses;
  const ModeBudget budget =
      options.quick ? ModeBudget{.errors_s = 2, .timing_s = 0.1, .env_s = 0.1} : ModeBudget{.errors_s = 30, .timing_s = 3, .env_s = 5};
  result.markdown =
      "| scene | late sound | env steps/s, 1 thread | 2 threads | ms per response | ms per source | T20 heard, % | T20 of the energy, % | "
      "spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|\n";
  for (const SceneName& name : scenes) {
    StudyScene scene(name, poses, options.quick ? kTruthRays / 8 : kTruthRays);
    Progress progress("truth of " + name.name, "permille", 1000);
    const Stopwatch watch;
    do {
      scene.truth().add_round();
      progress.update(static_cast<std::uint64_t>(1000 * std::min(watch.wall_s() / options.truth_seconds, 1.0)));
    } while (watch.wall_s() < options.truth_seconds);
    const SceneFacts facts = scene.finish_truth();
    for (const AccuracyMode& mode : modes()) {
      const ModeResult run = scene.run(mode, budget);
      const BenchJson setting = {{"scene", facts.spec},
                                 {"triangles", facts.triangles},
                                 {"mode", mode.method},
                                 {"rir_length_s", run.rir_length_s},
                                 {"poses", run.errors.poses},
                                 {"reference_rt60_standard_error_pct", facts.truth_error_pct},
                                 {"reference_runs", facts.truth_rounds}};
      const auto add = [&](const std::string& metric, const char* unit, double value) {
        result.report.add(fmt::format("hearing.{}.{}", mode.value, metric), unit, median_of({value}), setting);
      };
      const ErrorSummary heard = run.error(ErrorKind::rir_to_rir_t20), energy = run.error(ErrorKind::t20),
                         seen = run.error(ErrorKind::spectral_db);
      const double heard_pct = scale_of(ErrorKind::rir_to_rir_t20) * heard.mean, energy_pct = scale_of(ErrorKind::t20) * energy.mean;
      add("steps_per_s", "1/s", run.steps_per_s_one);
      add("two_threads.steps_per_s", "1/s", run.steps_per_s_two);
      add("response_ms", "ms", run.per_rir_ms);
      add("source_ms", "ms", run.per_source_ms);
      add("rt60_error_pct.rir", "%", heard_pct);
      add("rt60_error_pct.energy", "%", energy_pct);
      add("spectrogram_error_db", "dB", seen.mean);
      result.markdown +=
          fmt::format("| {} | {} | {:.0f} | {:.0f} | {:.2f} | {:.0f} | {:.1f} | {:.1f} | {:.2f} |\n", name.name, mode.method,
                      run.steps_per_s_one, run.steps_per_s_two, run.per_rir_ms, run.per_source_ms, heard_pct, energy_pct, seen.mean);
    }
    result.markdown +=
        fmt::format("\n{}: {}, {} triangles, RT60 {:.2f} s; the reference has {} runs at {} poses, standard error of T20 {:.1f} %.\n\n",
                    name.name, facts.spec, facts.triangles, facts.rt60_s, facts.truth_rounds, facts.poses, facts.truth_error_pct);
  }
  return result;
}

}  // namespace earshot
