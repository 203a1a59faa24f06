// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "bench/accuracy/accuracy_report.h"
#include "bench/measure/table_cell.h"
#include "sim/base/engine_commit.h"

namespace earshot {
namespace {

std::string with_error(const ModeMean& mean) {
  if (mean.scenes == 0) return "-";
  const std::string missing = mean.missing > 0 ? fmt::format(" ({} missing)", mean.missing) : "";
  return table_cell(mean.mean) + (mean.standard_error > 0 ? " ± " + table_cell(mean.standard_error, "{:.2g}") : "") + missing;
}

template <class Value>
double mean_of(const AccuracyStudy& study, const std::string& sweep, const std::string& value, const Value& get) {
  double sum = 0;
  int count = 0;
  for (const ModeResult& result : study.results)
    if (result.sweep == sweep && result.value == value && is_in_means(result.scene)) sum += get(result), ++count;
  return count > 0 ? sum / count : kNoMean;
}

/// Modes in the order of the study, each once.
std::vector<const ModeResult*> modes_of(const AccuracyStudy& study) {
  std::vector<const ModeResult*> modes;
  for (const ModeResult& result : study.results)
    if (std::none_of(modes.begin(), modes.end(), [&](const ModeResult* m) { return m->sweep == result.sweep && m->value == result.value; }))
      modes.push_back(&result);
  return modes;
}

/// Of the T20 error of a preset in a scene, as the truth and the poses leave it; NaN where it was not run.
double t20_rms_error_pct(const AccuracyStudy& study, const std::string& scene, const std::string& preset) {
  for (const ModeResult& result : study.results)
    if (result.scene == scene && result.sweep == "preset" && result.value == preset && result.error(ErrorKind::t20).count > 0)
      return 100 * result.error(ErrorKind::t20).rms_error;
  return kNoMean;
}

std::string scenes_table(const AccuracyStudy& study) {
  std::string text =
      "## Scenes and their truth\n\n| scene | SCENE | triangles | RT60 (T20), s | truth: runs of each half at a pose | rays a run | time, "
      "s "
      "| poses | standard error of one T20 of the truth |";
  std::string rule = "|---|---|---|---|---|---|---|---|---|";
  for (const std::string& preset : presets_of(study))
    text += fmt::format(" standard error of the T20 error (rms) of `{}` |", preset), rule += "---|";
  text += "\n" + rule + "\n";
  for (const SceneFacts& scene : study.scenes) {
    text += fmt::format("| {} | `{}` | {} | {} | {} | {} | {:.0f} | {} | {} |", scene.name,
                        std::filesystem::path(scene.spec).filename().string(), scene.triangles, table_cell(scene.rt60_s),
                        scene.truth_rounds, scene.truth_rays, scene.truth_s, scene.poses,
                        std::isfinite(scene.truth_error_pct) ? table_cell(scene.truth_error_pct) + " %" : "-");
    for (const std::string& preset : presets_of(study)) {
      const double error = t20_rms_error_pct(study, scene.name, preset);
      text += fmt::format(" {} |", std::isfinite(error) ? table_cell(error, "{:.2g}") + " %" : "-");
    }
    text += "\n";
  }
  return text;
}

std::string quality_table(const AccuracyStudy& study) {
  const std::string machine = machine_json()["cpu"].get<std::string>();
  std::string text = fmt::format(
      "\n## Quality modes, as in Table 1 of the paper\n\nRIRs per second on {}, 16 kHz, two ears, RIRs as long as each scene needs; mean "
      "over the closed scenes above of the time "
      "per RIR, {} RIRs sharing one source whose cost is included (warm: not included). Errors: mean of absolute values over bands, poses "
      "and "
      "the closed scenes, ± one standard error; root mean squares without the noise of the reference are in the tables below.\n\n",
      machine, kEpisodeSteps);
  text +=
      "| quality mode | RIR/s, 1 thread | RIR/s, 1 thread, warm | RIR/s, 2 threads, warm | env steps/s, 1 thread | env steps/s, 2 threads "
      "| RT60 error (T20), % | T20 of "
      "the rendered RIR, % | DRR, dB | EDC rms, dB | spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const ModeResult* mode : modes_of(study)) {
    if (mode->sweep != "preset") continue;
    const auto mean = [&](ErrorKind kind) { return with_error(mean_over_scenes(study, "preset", mode->value, kind)); };
    // Rates are those of the mean time, as a trainer that visits the scenes in turn would see them.
    const auto rate = [&](const auto& seconds) { return table_cell(1 / mean_of(study, "preset", mode->value, seconds)); };
    const bool steps = mode->steps_per_s_one > 0;
    text += fmt::format("| `{}` | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", mode->value,
                        rate([](const ModeResult& r) { return 1e-3 * r.shared_ms(kEpisodeSteps); }),
                        rate([](const ModeResult& r) { return 1e-3 * r.per_rir_ms; }),
                        rate([](const ModeResult& r) { return 1 / r.rirs_per_s_two; }),
                        steps ? rate([](const ModeResult& r) { return 1 / r.steps_per_s_one; }) : "-",
                        steps ? rate([](const ModeResult& r) { return 1 / r.steps_per_s_two; }) : "-", mean(ErrorKind::t20),
                        mean(ErrorKind::rir_t20), mean(ErrorKind::drr_db), mean(ErrorKind::decay_db), mean(ErrorKind::spectral_db));
  }
  text +=
      "| SoundSpaces 2.0, high speed (quoted) | 7.7 ± 0.2 | | | | | 9.5 ± 0.2 | | | | |\n"
      "| SoundSpaces 2.0, high quality (quoted) | 0.9 | | | | | 0.0 by definition | | | | |\n"
      "\nQuoted rows: Chen et al. 2022, Table 1: Xeon Gold 6230 at 2.10 GHz, 20 Matterport3D scenes; its error is against its own high "
      "quality mode, by a decay-time estimator that the paper does not name. On 5 threads it gives 33.5 ± 0.4 and 4.0 RIRs per second. Its "
      "processor is older, so the machine explains a part of any ratio of speeds, and the scenes differ.\n";
  return text;
}

std::string sweeps_table(const AccuracyStudy& study) {
  std::string text =
      "\n## Sweeps\n\nMean over scenes; ms per RIR with 500 RIRs per source, pass included. *missing*: bands and poses for which "
      "the mode has no decay time in either draw although the reference has one, because the RIR of the mode is too short.\n\n| sweep | "
      "value | late part | ms per RIR "
      "| warm ms | T20, "
      "% | T30, % | "
      "EDC, dB | T20 of RIR, % | DRR, dB | ILD, dB | IACC | spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const ModeResult* mode : modes_of(study)) {
    if (mode->sweep == "preset") continue;
    text += fmt::format("| {} | {} | {} | {} | {} |", mode->sweep, mode->value, mode->method,
                        table_cell(mean_shared_ms(study, mode->sweep, mode->value, kEpisodeSteps)),
                        table_cell(mean_of(study, mode->sweep, mode->value, [](const ModeResult& r) { return r.per_rir_ms; })));
    for (const ErrorKind kind : {ErrorKind::t20, ErrorKind::t30, ErrorKind::decay_db, ErrorKind::rir_t20, ErrorKind::drr_db,
                                 ErrorKind::ild_db, ErrorKind::iacc, ErrorKind::spectral_db})
      text += fmt::format(" {} |", with_error(mean_over_scenes(study, mode->sweep, mode->value, kind)));
    text += "\n";
  }
  return text;
}

}  // namespace

std::vector<std::string> presets_of(const AccuracyStudy& study) {
  std::vector<std::string> presets;
  for (const ModeResult& result : study.results)
    if (result.sweep == "preset" && std::ranges::find(presets, result.value) == presets.end()) presets.push_back(result.value);
  return presets;
}

std::string accuracy_markdown(const AccuracyStudy& study) {
  return fmt::format("<!-- written by `earshot bench accuracy`, commit {} -->\n", engine_commit()) + scenes_table(study) +
         quality_table(study) + preset_scenes_table(study) + bias_table(study) + octave_table(study) + noticeable_table(study) +
         sweeps_table(study) + scaling_markdown(study.scaling) + engines_markdown(study.engines);
}

}  // namespace earshot
