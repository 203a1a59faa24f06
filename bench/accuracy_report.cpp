#include "bench/accuracy_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "bench/accuracy_figures.h"
#include "envs/engine_commit.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kEpisodeSteps = 500;

std::string cell(double value, const char* digits = "{:.3g}") {
  return std::isfinite(value) ? fmt::format(fmt::runtime(digits), value) : std::string("-");
}

std::string with_error(const ModeMean& mean) {
  if (mean.scenes == 0) return "-";
  const std::string missing = mean.missing > 0 ? fmt::format(" ({} missing)", mean.missing) : "";
  return cell(mean.mean) + (mean.standard_error > 0 ? " ± " + cell(mean.standard_error, "{:.2g}") : "") + missing;
}

template <class Value>
double mean_of(const AccuracyStudy& study, const std::string& sweep, const std::string& value, const Value& get) {
  double sum = 0;
  int count = 0;
  for (const ModeResult& result : study.results)
    if (result.sweep == sweep && result.value == value) sum += get(result), ++count;
  return count > 0 ? sum / count : kNan;
}

/// Modes in the order of the study, each once.
std::vector<const ModeResult*> modes_of(const AccuracyStudy& study) {
  std::vector<const ModeResult*> modes;
  for (const ModeResult& result : study.results)
    if (std::none_of(modes.begin(), modes.end(), [&](const ModeResult* m) { return m->sweep == result.sweep && m->value == result.value; }))
      modes.push_back(&result);
  return modes;
}

std::string scenes_table(const AccuracyStudy& study) {
  std::string text =
      "## Scenes and their truth\n\n| scene | SCENE | triangles | RT60 (T20), s | truth: runs of `high` | poses | its standard error in "
      "T20 |\n|---|---|---|---|---|---|---|\n";
  for (const SceneFacts& scene : study.scenes)
    text += fmt::format("| {} | `{}` | {} | {} | {} | {} | {} |\n", scene.name, std::filesystem::path(scene.spec).filename().string(),
                        scene.triangles, cell(scene.rt60_s), scene.truth_runs, scene.poses,
                        std::isfinite(scene.truth_error_pct) ? cell(scene.truth_error_pct) + " %" : "-");
  return text;
}

std::string quality_table(const AccuracyStudy& study) {
  const std::string machine = machine_json()["cpu"].get<std::string>();
  std::string text = fmt::format(
      "\n## Quality modes, as in Table 1 of the paper\n\nRIRs per second on {}, 16 kHz, two ears, RIRs as long as each scene needs; mean "
      "over the scenes above of the time "
      "per RIR, {} RIRs sharing one source whose cost is included (warm: not included). Errors: mean of absolute values over bands, poses "
      "and "
      "scenes, ± one standard error.\n\n",
      machine, kEpisodeSteps);
  text +=
      "| quality mode | RIR/s, 1 thread | RIR/s, 1 thread, warm | RIR/s, 2 threads, warm | env steps/s, 1 thread | env steps/s, 2 threads "
      "| RT60 error (T20), % | T20 of "
      "the rendered RIR, % | DRR, dB | EDC rms, dB | spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const ModeResult* mode : modes_of(study)) {
    if (mode->sweep != "preset") continue;
    const auto mean = [&](ErrorKind kind) { return with_error(mean_over_scenes(study, "preset", mode->value, kind)); };
    // Rates are those of the mean time, as a trainer that visits the scenes in turn would see them.
    const auto rate = [&](const auto& seconds) { return cell(1 / mean_of(study, "preset", mode->value, seconds)); };
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
      "quality "
      "mode, by a decay-time estimator that it does not name. On 5 threads it gives 33.5 ± 0.4 and 4.0 RIRs per second. Its processor is "
      "older: "
      "a part of any ratio of speeds is the machine's, and the scenes differ.\n";
  return text;
}

std::string preset_table(const AccuracyStudy& study) {
  std::string text =
      "\n## Presets, scene by scene\n\n| scene | mode | late part | RIR, s | per source, ms | per RIR, ms | T20, % | T30, % | EDT, % | "
      "C50, dB | DRR, dB "
      "| EDC, dB | T20 of RIR, % | ILD, dB | IACC | spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const ModeResult& result : study.results) {
    if (result.sweep != "preset") continue;
    text += fmt::format("| {} | `{}` | {} | {:.2g} | {} | {} |", result.scene, result.value,
                        result.method == "bidirectional" ? "bidirectional"
                        : result.field                   ? "field"
                                                         : "tracer",
                        result.rir_length_s, cell(result.per_source_ms), cell(result.per_rir_ms));
    for (const ErrorKind kind : {ErrorKind::t20, ErrorKind::t30, ErrorKind::edt, ErrorKind::c50_db, ErrorKind::drr_db, ErrorKind::decay_db,
                                 ErrorKind::rir_t20, ErrorKind::ild_db, ErrorKind::iacc, ErrorKind::spectral_db})
      text += fmt::format(" {} |", cell(scale_of(kind) * result.error(kind).mean));
    text += "\n";
  }
  return text;
}

std::string sweeps_table(const AccuracyStudy& study) {
  std::string text =
      "\n## Sweeps\n\nMean over scenes; ms per RIR with 500 RIRs per source, pass included. *missing*: bands and poses whose decay time "
      "the mode "
      "could not give though the truth has one, because its RIR is too short.\n\n| sweep | value | late part | ms per RIR | warm ms | T20, "
      "% | T30, % | "
      "EDC, dB | T20 of RIR, % | DRR, dB | ILD, dB | IACC | spectrogram, dB |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const ModeResult* mode : modes_of(study)) {
    if (mode->sweep == "preset") continue;
    text += fmt::format("| {} | {} | {} | {} | {} |", mode->sweep, mode->value, mode->method,
                        cell(mean_shared_ms(study, mode->sweep, mode->value, kEpisodeSteps)),
                        cell(mean_of(study, mode->sweep, mode->value, [](const ModeResult& r) { return r.per_rir_ms; })));
    for (const ErrorKind kind : {ErrorKind::t20, ErrorKind::t30, ErrorKind::decay_db, ErrorKind::rir_t20, ErrorKind::drr_db,
                                 ErrorKind::ild_db, ErrorKind::iacc, ErrorKind::spectral_db})
      text += fmt::format(" {} |", with_error(mean_over_scenes(study, mode->sweep, mode->value, kind)));
    text += "\n";
  }
  return text;
}

}  // namespace

ModeMean mean_over_scenes(const AccuracyStudy& study, const std::string& sweep, const std::string& value, ErrorKind kind) {
  ModeMean mean;
  double sum = 0, squares = 0;
  for (const ModeResult& result : study.results) {
    if (result.sweep != sweep || result.value != value || result.scene == kOpenScene) continue;
    const ErrorSummary& error = result.error(kind);
    mean.missing += error.missing;
    if (error.count == 0) continue;
    sum += error.mean;
    if (std::isfinite(error.standard_error)) squares += error.standard_error * error.standard_error;
    ++mean.scenes;
  }
  mean.mean = mean.scenes > 0 ? scale_of(kind) * sum / mean.scenes : kNan;
  mean.standard_error = mean.scenes > 0 ? scale_of(kind) * std::sqrt(squares) / mean.scenes : kNan;
  return mean;
}

double mean_shared_ms(const AccuracyStudy& study, const std::string& sweep, const std::string& value, int n,
                      std::optional<ErrorKind> kind) {
  double sum = 0;
  int count = 0;
  for (const ModeResult& result : study.results)
    if (result.sweep == sweep && result.value == value && result.scene != kOpenScene && (!kind || result.error(*kind).count > 0))
      sum += result.shared_ms(n), ++count;
  return count > 0 ? sum / count : kNan;
}

std::string accuracy_csv(const AccuracyStudy& study) {
  std::string text =
      "scene,sweep,value,method,field,rir_length_s,per_source_ms,per_rir_ms,ms_n500,rirs_per_s_1_thread_n500,rirs_per_s_1_thread_warm,"
      "rirs_per_s_2_threads_warm,env_steps_per_s_1_thread,env_steps_per_s_2_threads,poses";
  for (int k = 0; k < kNumErrorKinds; ++k) {
    const std::string name = name_of(static_cast<ErrorKind>(k));
    for (const char* part : {"mean", "rms", "p95", "standard_error", "count", "missing"}) text += fmt::format(",{}_{}", name, part);
  }
  text += "\n";
  const auto number = [](double value) { return std::isfinite(value) ? fmt::format("{:.6g}", value) : std::string(); };
  for (const ModeResult& r : study.results) {
    const double ms = r.shared_ms(kEpisodeSteps);
    text += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", r.scene, r.sweep, r.value, r.method, r.field ? 1 : 0,
                        number(r.rir_length_s), number(r.per_source_ms), number(r.per_rir_ms), number(ms), number(1e3 / ms),
                        number(1e3 / r.per_rir_ms), number(r.rirs_per_s_two), r.steps_per_s_one > 0 ? number(r.steps_per_s_one) : "",
                        r.steps_per_s_two > 0 ? number(r.steps_per_s_two) : "", r.poses);
    for (int k = 0; k < kNumErrorKinds; ++k) {
      const auto kind = static_cast<ErrorKind>(k);
      const ErrorSummary& e = r.error(kind);
      const double scale = scale_of(kind);
      text += fmt::format(",{},{},{},{},{},{}", number(scale * e.mean), number(scale * e.rms), number(scale * e.p95),
                          number(scale * e.standard_error), e.count, e.missing);
    }
    text += "\n";
  }
  return text;
}

std::string accuracy_markdown(const AccuracyStudy& study) {
  return fmt::format("<!-- written by `earshot bench accuracy`, commit {} -->\n", engine_commit()) + scenes_table(study) +
         quality_table(study) + preset_table(study) + sweeps_table(study);
}

void write_accuracy_files(const AccuracyStudy& study, const std::filesystem::path& folder) {
  write_file_atomically(folder / "accuracy.csv", accuracy_csv(study));
  write_file_atomically(folder / "accuracy_tables.md", accuracy_markdown(study));
  write_file_atomically(folder / "accuracy_pareto.svg", pareto_figure(study));
  write_file_atomically(folder / "accuracy_scenes.svg", scenes_figure(study));
  write_file_atomically(folder / "accuracy_sweeps.svg", sweeps_figure(study));
}

BenchReport accuracy_bench_report(const AccuracyStudy& study) {
  BenchReport report("accuracy");
  for (const ModeResult& r : study.results) {
    if (r.sweep != "preset") continue;
    const BenchJson setting = {
        {"scene", r.scene}, {"threads", 1}, {"rir_length_s", r.rir_length_s}, {"field", r.field}, {"poses", r.poses}};
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
  }
  return report;
}

}  // namespace earshot
