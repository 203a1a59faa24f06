// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/accuracy/accuracy_report.h"
#include "bench/accuracy/accuracy_tables.h"
#include "bench/measure/table_cell.h"

namespace earshot {
namespace {

std::string rms_cell(double rms, double error) { return table_cell(rms) + (error > 0 ? " ± " + table_cell(error, "{:.2g}") : ""); }

/// Decay times of the open scene are those of one reflection.
bool has_meaning(const std::string& scene, ErrorKind kind) {
  if (is_in_means(scene)) return true;
  return kind != ErrorKind::t20 && kind != ErrorKind::t30 && kind != ErrorKind::edt && kind != ErrorKind::rir_t20 &&
         kind != ErrorKind::rir_to_rir_t20;
}

/// Octaves of the first scene, which are those of all.
std::vector<float> octaves_of(const AccuracyStudy& study) {
  return study.scenes.empty() ? std::vector<float>{} : study.scenes.front().bands_hz;
}

constexpr ErrorKind kSceneKinds[] = {ErrorKind::t20,      ErrorKind::t30,        ErrorKind::edt,         ErrorKind::decay_db,
                                     ErrorKind::c50_db,   ErrorKind::drr_db,     ErrorKind::drr_band_db, ErrorKind::early_db,
                                     ErrorKind::level_db, ErrorKind::rir_t20,    ErrorKind::ild_db,      ErrorKind::itd_us,
                                     ErrorKind::iacc,     ErrorKind::spectral_db};

std::string unit_of_kind(ErrorKind kind) {
  const std::string name = name_of(kind);
  return name.ends_with("_pct") ? ", %" : name.ends_with("_db") ? ", dB" : name.ends_with("_us") ? ", us" : "";
}

}  // namespace

std::string preset_scenes_table(const AccuracyStudy& study) {
  std::string text =
      "\n## Presets, scene by scene\n\nRoot mean squares over bands and poses, without the noise of the truth; in the open a decay time "
      "has "
      "no meaning.\n\n| scene | mode | late part | RIR, s | poses | per source, ms | per RIR, ms |";
  std::string rule = "|---|---|---|---|---|---|---|";
  for (const ErrorKind kind : kSceneKinds) text += fmt::format(" {}{} |", facts_of(kind).title, unit_of_kind(kind)), rule += "---|";
  text += "\n" + rule + "\n";
  for (const ModeResult& result : study.results) {
    if (result.sweep != "preset") continue;
    text += fmt::format("| {} | `{}` | {} | {:.2g} | {} | {} | {} |", result.scene, result.value,
                        result.method == "bidirectional" ? "bidirectional"
                        : result.field                   ? "field"
                                                         : "tracer",
                        result.rir_length_s, result.errors.poses, table_cell(result.per_source_ms), table_cell(result.per_rir_ms));
    for (const ErrorKind kind : kSceneKinds)
      text += fmt::format(" {} |", has_meaning(result.scene, kind) ? table_cell(scale_of(kind) * result.error(kind).rms) : "-");
    text += "\n";
  }
  return text;
}

std::string bias_table(const AccuracyStudy& study) {
  std::string text =
      "\n## Bias and scatter\n\nTwo draws of each mode (two seeds, or two fields). *rms*: error of one draw. Its square is the sum of the "
      "squares of the *bias*, which both draws share at a pose and band, and of the *scatter*, by which they differ. *mean error*: signed. "
      "*mean size*: mean of absolute values, which includes the noise of the reference. Root mean square over scenes.\n\n| mode | error "
      "| rms | bias | scatter "
      "| mean error | mean size |\n|---|---|---|---|---|---|---|\n";
  for (const std::string& preset : presets_of(study))
    for (const ErrorKind kind : kSceneKinds) {
      const ModeMean mean = mean_over_scenes(study, "preset", preset, kind);
      if (mean.scenes == 0) continue;
      text += fmt::format("| `{}` | {}{} | {} | {} | {} | {} | {} |\n", preset, facts_of(kind).title, unit_of_kind(kind),
                          rms_cell(mean.rms, mean.rms_error), table_cell(mean.bias), table_cell(mean.deviation),
                          table_cell(mean.signed_mean, "{:+.3g}"), rms_cell(mean.mean, mean.standard_error));
    }
  text += "\nT20, scene by scene:\n\n| scene | mode | rms, % | bias, % | scatter, % | mean error, % |\n|---|---|---|---|---|---|\n";
  for (const ModeResult& result : study.results) {
    if (result.sweep != "preset" || !has_meaning(result.scene, ErrorKind::t20)) continue;
    const ErrorSummary& t20 = result.error(ErrorKind::t20);
    text += fmt::format("| {} | `{}` | {} | {} | {} | {} |\n", result.scene, result.value, rms_cell(100 * t20.rms, 100 * t20.rms_error),
                        rms_cell(100 * t20.bias, 100 * t20.bias_error), table_cell(100 * t20.deviation),
                        table_cell(100 * t20.signed_mean, "{:+.3g}"));
  }
  return text;
}

std::string octave_table(const AccuracyStudy& study) {
  const std::vector<float> octaves = octaves_of(study);
  if (octaves.empty()) return "";
  std::string text = "\n## Presets, octave by octave\n\nRoot mean squares over poses and scenes.\n\n| mode | error |", rule = "|---|---|";
  for (const float hz : octaves) text += fmt::format(" {:.0f} Hz |", hz), rule += "---|";
  text += "\n" + rule + "\n";
  for (const std::string& preset : presets_of(study))
    for (const ErrorKind kind : {ErrorKind::t20, ErrorKind::decay_db, ErrorKind::c50_db, ErrorKind::drr_band_db, ErrorKind::early_db,
                                 ErrorKind::level_db, ErrorKind::ild_db, ErrorKind::itd_us, ErrorKind::iacc}) {
      text += fmt::format("| `{}` | {}{} |", preset, facts_of(kind).title, unit_of_kind(kind));
      for (std::size_t band = 0; band < octaves.size(); ++band)
        text += fmt::format(" {} |", table_cell(mean_over_scenes(study, "preset", preset, kind, static_cast<int>(band)).rms));
      text += "\n";
    }
  return text;
}

NoticeableErrors count_noticeable(std::vector<double> sizes, double noticeable) {
  NoticeableErrors errors;
  errors.count = sizes.size();
  if (sizes.empty()) {
    errors.p50 = errors.p95 = errors.within_pct = std::numeric_limits<double>::quiet_NaN();
    return errors;
  }
  std::ranges::sort(sizes);
  const auto n = static_cast<double>(sizes.size());
  const auto quantile = [&](double fraction) {
    return sizes[static_cast<std::size_t>(std::max(std::ceil(fraction * n), 1.0)) - 1] / noticeable;
  };
  errors.p50 = quantile(0.5);
  errors.p95 = quantile(0.95);
  errors.within_pct = 100 * static_cast<double>(std::ranges::upper_bound(sizes, noticeable) - sizes.begin()) / n;
  return errors;
}

NoticeableErrors noticeable_errors(const AccuracyStudy& study, const std::string& preset, ErrorKind kind) {
  std::vector<double> sizes;
  for (const ModeResult& result : study.results) {
    if (result.sweep != "preset" || result.value != preset || !is_in_means(result.scene)) continue;
    const std::vector<double>& of_scene = result.errors.sizes[static_cast<std::size_t>(kind)];
    sizes.insert(sizes.end(), of_scene.begin(), of_scene.end());
  }
  return count_noticeable(std::move(sizes), facts_of(kind).noticeable);
}

std::string noticeable_table(const AccuracyStudy& study) {
  std::string text =
      "\n## What is heard of it\n\nAbsolute errors in just-noticeable differences, over all bands, poses and closed scenes, with the "
      "noise of the reference.\n\n| mode | error | one difference | whose number | median | 95th percentile | within one, % | values "
      "|\n|---|---|---|---|---|---|---|---|\n";
  const auto row = [&](const std::string& mode, ErrorKind kind, const NoticeableErrors& errors) {
    if (errors.count == 0) return;
    const ErrorKindFacts& facts = facts_of(kind);
    text += fmt::format("| {} | {} | {:g}{} | {} | {} | {} | {:.0f} | {} |\n", mode, facts.title, facts.noticeable,
                        unit_of_kind(kind).empty() ? "" : unit_of_kind(kind).substr(1), facts.noticed, table_cell(errors.p50, "{:.2g}"),
                        table_cell(errors.p95, "{:.2g}"), errors.within_pct, errors.count);
  };
  for (const std::string& preset : presets_of(study))
    for (const ErrorKind kind : kSceneKinds)
      if (has_noticeable(kind)) row("`" + preset + "`", kind, noticeable_errors(study, preset, kind));
  for (const ModeResult& result : study.results) {
    if (result.sweep != "preset" || is_in_means(result.scene)) continue;
    for (const ErrorKind kind : kSceneKinds)
      if (has_noticeable(kind) && has_meaning(result.scene, kind))
        row(fmt::format("`{}`, {}", result.value, result.scene), kind,
            count_noticeable(result.errors.sizes[static_cast<std::size_t>(kind)], facts_of(kind).noticeable));
  }
  return text;
}

}  // namespace earshot
