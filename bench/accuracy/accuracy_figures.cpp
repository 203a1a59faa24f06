// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "bench/accuracy/accuracy_report.h"
#include "bench/measure/bench_report.h"
#include "bench/measure/plot_svg.h"

namespace earshot {
namespace {

/// Of which means are taken.
std::ptrdiff_t num_closed_scenes(const AccuracyStudy& study) {
  return std::count_if(study.scenes.begin(), study.scenes.end(), [](const SceneFacts& scene) { return scene.name != kOpenScene; });
}

constexpr int kShared = 500;
constexpr const char *kTracerColour = "#d9480f", *kFieldColour = "#2a6fdb", *kPresetColour = "#111111", *kOriginalColour = "#9c36b5";

/// Of one sweep over the method it belongs to.
struct Front {
  const char *sweep, *name, *colour;
};
constexpr Front kFronts[] = {{"rays", "path tracer, by rays", kTracerColour}, {"photons", "source field, by photons", kFieldColour}};

std::vector<std::string> values_of(const AccuracyStudy& study, const std::string& sweep) {
  std::vector<std::string> values;
  for (const ModeResult& r : study.results)
    if (r.sweep == sweep && std::find(values.begin(), values.end(), r.value) == values.end()) values.push_back(r.value);
  return values;
}

AccuracyStudy select_scene(const AccuracyStudy& study, const std::string& scene) {
  AccuracyStudy selected;
  for (const SceneFacts& facts : study.scenes)
    if (facts.name == scene) selected.scenes.push_back(facts);
  for (const ModeResult& result : study.results)
    if (result.scene == scene) selected.results.push_back(result);
  return selected;
}

PlotPoint point_of(const AccuracyStudy& study, const std::string& sweep, const std::string& value, ErrorKind kind) {
  const ModeMean mean = mean_over_scenes(study, sweep, value, kind);
  return {mean_shared_ms(study, sweep, value, kShared, kind), mean.mean, mean.standard_error, value};
}

PlotPanel front_panel(const AccuracyStudy& study, const std::string& title, ErrorKind kind, const std::string& y_label,
                      const PlotLevel& heard) {
  PlotPanel panel{.title = title, .x_label = "ms per RIR on one thread, 500 RIRs per source", .y_label = y_label, .levels = {heard}};
  for (const Front& front : kFronts) {
    PlotSeries series{.name = front.name, .colour = front.colour};
    for (const std::string& value : values_of(study, front.sweep)) series.points.push_back(point_of(study, front.sweep, value, kind));
    std::sort(series.points.begin(), series.points.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
    panel.series.push_back(std::move(series));
  }
  PlotSeries presets{.name = "presets", .colour = kPresetColour, .marker = PlotMarker::diamond, .line = false};
  for (const std::string& value : values_of(study, "preset")) presets.points.push_back(point_of(study, "preset", value, kind));
  panel.series.push_back(std::move(presets));
  return panel;
}

/// The truth's own error: smaller ones cannot be resolved.
void add_truth_level(PlotPanel& panel, const AccuracyStudy& study) {
  double sum = 0;
  int count = 0;
  for (const SceneFacts& facts : study.scenes)
    if (std::isfinite(facts.truth_error_pct)) sum += facts.truth_error_pct, ++count;
  if (count > 0) panel.levels.push_back({sum / count, fmt::format("standard error of one T20 of the truth, {:.2g} %", sum / count)});
}

std::string machine() { return machine_json()["cpu"].get<std::string>(); }

}  // namespace

std::string pareto_figure(const AccuracyStudy& study) {
  PlotPanel rt60 = front_panel(study, "Reverberation time", ErrorKind::t20, "mean |T20 error|, %", {5, "just heard: 5 %"});
  add_truth_level(rt60, study);
  // Its reference mode has no error by definition, which a logarithmic axis cannot show: it is drawn at the foot with a label.
  double lowest = 5;
  for (const PlotSeries& series : rt60.series)
    for (const PlotPoint& point : series.points)
      if (point.y > 0) lowest = std::min(lowest, point.y);
  rt60.series.push_back({.name = "SoundSpaces 2.0 (from its paper, Xeon Gold 6230)",
                         .colour = kOriginalColour,
                         .marker = PlotMarker::star,
                         .line = false,
                         .points = {{1e3 / 7.7, 9.5, 0.2, "high speed"}, {1e3 / 0.9, lowest, 0, "high quality: 0 by definition"}}});
  const PlotPanel decay = front_panel(study, "Decay curve", ErrorKind::decay_db, "rms over 0 to -30 dB, dB", {1, "just heard: 1 dB"});
  return plot_svg("Error against computing time",
                  fmt::format("Mean over {} scenes, ± one standard error; {}, 16 kHz, two ears, source's pass included",
                              num_closed_scenes(study), machine()),
                  {rt60, decay}, 2);
}

std::string scenes_figure(const AccuracyStudy& study) {
  std::vector<PlotPanel> panels;
  for (const SceneFacts& facts : study.scenes) {
    const AccuracyStudy scene_study = select_scene(study, facts.name);
    const bool decays = std::isfinite(facts.rt60_s);
    PlotPanel panel =
        decays ? front_panel(scene_study, fmt::format("{}: {} triangles, RT60 {:.2g} s", facts.name, facts.triangles, facts.rt60_s),
                             ErrorKind::t20, "mean |T20 error|, %", {5, "just heard: 5 %"})
               : front_panel(scene_study, fmt::format("{}: {} triangles, no decay time", facts.name, facts.triangles),
                             ErrorKind::spectral_db, "spectrogram, rms dB", {1, "just heard: 1 dB"});
    if (decays) add_truth_level(panel, scene_study);
    panels.push_back(std::move(panel));
  }
  return plot_svg("Error against computing time, by scene", fmt::format("± one standard error over poses; {}, one thread", machine()),
                  panels, 2);
}

std::string sweeps_figure(const AccuracyStudy& study) {
  struct Sweep {
    const char *sweep, *title;
    std::vector<ErrorKind> kinds;
    const char* y_label;
  };
  const Sweep sweeps[] = {
      {"bounces", "Bounces of a ray (path tracer, 256 rays)", {ErrorKind::t20, ErrorKind::t30}, "%"},
      {"RIR length", "Length of the RIR", {ErrorKind::t20, ErrorKind::rir_t20}, "%"},
      {"cell size", "Cells of the source field", {ErrorKind::t20, ErrorKind::t30, ErrorKind::rir_t20}, "%"},
      {"bands", "Bands (octaves: 7)", {ErrorKind::rir_t20}, "%"},
      {"SH order", "Harmonics of the late field", {ErrorKind::ild_db, ErrorKind::iacc, ErrorKind::spectral_db}, "dB, or 1 for IACC"},
      {"late decoding",
       "Late sound decoded as a waveform",
       {ErrorKind::ild_db, ErrorKind::iacc, ErrorKind::spectral_db},
       "dB, or 1 for IACC"},
      {"effects", "Effects", {ErrorKind::decay_db, ErrorKind::spectral_db, ErrorKind::c50_db}, "dB"}};
  struct ErrorStyle {
    ErrorKind kind;
    const char *name, *colour;
  };
  const ErrorStyle styles[] = {{ErrorKind::t20, "T20", kFieldColour},
                               {ErrorKind::t30, "T30", "#2e9a4f"},
                               {ErrorKind::rir_t20, "T20 of the rendered RIR", kTracerColour},
                               {ErrorKind::decay_db, "decay curve", "#0b7285"},
                               {ErrorKind::spectral_db, "spectrogram", "#5c3d2e"},
                               {ErrorKind::c50_db, "C50", "#c2255c"},
                               {ErrorKind::ild_db, "ILD", kOriginalColour},
                               {ErrorKind::iacc, "IACC", "#868e96"}};
  std::vector<PlotPanel> panels;
  for (const Sweep& sweep : sweeps) {
    const std::vector<std::string> values = values_of(study, sweep.sweep);
    if (values.empty()) continue;
    PlotPanel panel{
        .title = sweep.title, .x_label = sweep.sweep, .y_label = std::string("mean error, ") + sweep.y_label, .categories = values};
    for (const ErrorStyle& style : styles) {
      if (std::find(sweep.kinds.begin(), sweep.kinds.end(), style.kind) == sweep.kinds.end()) continue;
      PlotSeries series{.name = style.name, .colour = style.colour, .line = std::string(sweep.sweep) != "effects"};
      for (std::size_t i = 0; i < values.size(); ++i) {
        PlotPoint point = point_of(study, sweep.sweep, values[i], style.kind);
        point.x = static_cast<double>(i);
        point.label.clear();
        series.points.push_back(point);
      }
      panel.series.push_back(std::move(series));
    }
    panels.push_back(std::move(panel));
  }
  if (panels.empty()) panels.push_back({.title = "no sweeps in a quick run", .x_label = "", .y_label = ""});
  return plot_svg("Error against each parameter",
                  fmt::format("About the preset fast, mean over {} scenes, ± one standard error", num_closed_scenes(study)), panels, 2);
}

}  // namespace earshot
