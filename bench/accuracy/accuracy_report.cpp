// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_report.h"

#include <fmt/format.h>

#include <cmath>
#include <tuple>

#include "bench/accuracy/accuracy_figures.h"
#include "bench/accuracy/accuracy_tables.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// Mean of what is finite.
class Mean {
 public:
  void add(double value) {
    if (std::isfinite(value)) sum_ += value, ++count_;
  }
  [[nodiscard]] double value() const { return count_ > 0 ? sum_ / count_ : kNoMean; }

 private:
  double sum_ = 0;
  int count_ = 0;
};

}  // namespace

bool is_in_means(const std::string& scene) { return scene != kOpenScene; }

ModeMean mean_over_scenes(const AccuracyStudy& study, const std::string& sweep, const std::string& value, ErrorKind kind, int band) {
  const auto k = static_cast<std::size_t>(kind);
  ModeMean mean;
  Mean size, sign, square, bias, variance;
  double errors = 0, square_errors = 0;
  for (const ModeResult& result : study.results) {
    if (result.sweep != sweep || result.value != value || !is_in_means(result.scene)) continue;
    if (band >= 0 && static_cast<std::size_t>(band) >= result.errors.by_band[k].size()) continue;
    const ErrorSummary& error = band < 0 ? result.error(kind) : result.errors.by_band[k][static_cast<std::size_t>(band)];
    mean.missing += error.missing;
    if (error.count == 0) continue;
    ++mean.scenes;
    size.add(error.mean);
    sign.add(error.signed_mean);
    square.add(error.rms * error.rms);
    bias.add(error.bias * error.bias);
    variance.add(error.deviation * error.deviation);
    if (std::isfinite(error.standard_error)) errors += error.standard_error * error.standard_error;
    if (std::isfinite(error.rms_error)) square_errors += error.rms * error.rms * error.rms_error * error.rms_error;
  }
  const double scale = scale_of(kind);
  mean.mean = scale * size.value();
  mean.signed_mean = scale * sign.value();
  mean.rms = scale * std::sqrt(square.value());
  mean.bias = scale * std::sqrt(bias.value());
  mean.deviation = scale * std::sqrt(variance.value());
  mean.standard_error = mean.scenes > 0 ? scale * std::sqrt(errors) / mean.scenes : kNoMean;
  // d rms = sum of rms_s d rms_s / (scenes rms)
  mean.rms_error = mean.rms > 0 ? scale * scale * std::sqrt(square_errors) / (mean.scenes * mean.rms) : kNoMean;
  return mean;
}

double mean_shared_ms(const AccuracyStudy& study, const std::string& sweep, const std::string& value, int n,
                      std::optional<ErrorKind> kind) {
  Mean ms;
  for (const ModeResult& result : study.results)
    if (result.sweep == sweep && result.value == value && is_in_means(result.scene) && (!kind || result.error(*kind).count > 0))
      ms.add(result.shared_ms(n));
  return ms.value();
}

std::string accuracy_csv(const AccuracyStudy& study) {
  std::string text =
      "scene,sweep,value,method,field,rir_length_s,per_source_ms,per_rir_ms,ms_n500,rirs_per_s_1_thread_n500,rirs_per_s_1_thread_warm,"
      "rirs_per_s_2_threads_warm,env_steps_per_s_1_thread,env_steps_per_s_2_threads,poses";
  for (const ErrorKind kind : all_error_kinds())
    for (const char* part : {"mean", "standard_error", "signed_mean", "rms", "rms_standard_error", "bias", "bias_standard_error",
                             "deviation", "p50", "p95", "count", "missing"})
      text += fmt::format(",{}_{}", name_of(kind), part);
  text += "\n";
  const auto number = [](double value) { return std::isfinite(value) ? fmt::format("{:.6g}", value) : std::string(); };
  for (const ModeResult& r : study.results) {
    const double ms = r.shared_ms(kEpisodeSteps);
    text += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", r.scene, r.sweep, r.value, r.method, r.field ? 1 : 0,
                        number(r.rir_length_s), number(r.per_source_ms), number(r.per_rir_ms), number(ms), number(1e3 / ms),
                        number(1e3 / r.per_rir_ms), number(r.rirs_per_s_two), r.steps_per_s_one > 0 ? number(r.steps_per_s_one) : "",
                        r.steps_per_s_two > 0 ? number(r.steps_per_s_two) : "", r.errors.poses);
    for (const ErrorKind kind : all_error_kinds()) {
      const ErrorSummary& e = r.error(kind);
      for (const double value :
           {e.mean, e.standard_error, e.signed_mean, e.rms, e.rms_error, e.bias, e.bias_error, e.deviation, e.p50, e.p95})
        text += "," + number(scale_of(kind) * value);
      text += fmt::format(",{},{}", e.count, e.missing);
    }
    text += "\n";
  }
  return text;
}

void write_accuracy_files(const AccuracyStudy& study, const std::filesystem::path& folder) {
  write_file_atomically(folder / "accuracy.csv", accuracy_csv(study));
  write_file_atomically(folder / "accuracy_tables.md", accuracy_markdown(study));
  write_file_atomically(folder / "accuracy_pareto.svg", pareto_figure(study));
  write_file_atomically(folder / "accuracy_scenes.svg", scenes_figure(study));
  write_file_atomically(folder / "accuracy_sweeps.svg", sweeps_figure(study));
  write_file_atomically(folder / "accuracy_engines.svg", engines_figure(study.engines));
}

BenchReport accuracy_bench_report(const AccuracyStudy& study) {
  BenchReport report("accuracy");
  for (const ModeResult& r : study.results) {
    if (r.sweep != "preset") continue;
    const BenchJson setting = {
        {"scene", r.scene}, {"threads", 1}, {"rir_length_s", r.rir_length_s}, {"field", r.field}, {"poses", r.errors.poses}};
    BenchJson shared = setting;
    shared["n"] = kEpisodeSteps;
    const double rate = 1e3 / r.shared_ms(kEpisodeSteps);
    report.add(fmt::format("accuracy.{}.rir_per_s", r.value), "1/s", {rate, rate, rate}, shared);
    for (const auto& [name, unit, kind] :
         {std::tuple{"rt60_error_pct", "%", ErrorKind::t20}, std::tuple{"edc_rms_db", "dB", ErrorKind::decay_db}}) {
      const ErrorSummary& e = r.error(kind);
      const double mean = scale_of(kind) * e.mean, error = std::isfinite(e.standard_error) ? scale_of(kind) * e.standard_error : 0;
      report.add(fmt::format("accuracy.{}.{}", r.value, name), unit, {mean, mean - error, mean + error}, setting);
    }
    const ErrorSummary& t20 = r.error(ErrorKind::t20);
    const double rms = 100 * t20.rms, error = std::isfinite(t20.rms_error) ? 100 * t20.rms_error : 0;
    report.add(fmt::format("accuracy.{}.rt60_rms_error_pct", r.value), "%", {rms, rms - error, rms + error}, setting);
  }
  return report;
}

}  // namespace earshot
