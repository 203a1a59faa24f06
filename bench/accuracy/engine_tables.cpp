// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "bench/accuracy/engine_comparison.h"
#include "bench/measure/plot_svg.h"
#include "bench/measure/table_cell.h"

namespace earshot {
namespace {

std::string with_missing(double scale, const ErrorSummary& error) {
  return table_cell(scale * error.rms) + (error.missing > 0 ? fmt::format(" ({} missing)", error.missing / 2) : "");
}

/// A colour for the n-th engine.
const char* colour_of(std::size_t n) {
  static constexpr const char* colours[] = {"#9c36b5", "#2e9a4f", "#0b7285", "#c2255c", "#5c3d2e"};
  return colours[n % std::size(colours)];
}

const char* own_colour(const std::string& engine) {
  return engine == "earshot, source field" ? "#2a6fdb" : engine == "earshot, path tracer" ? "#d9480f" : "#111111";
}

std::string room_text(const ShoeboxRoom& room) { return fmt::format("{:g} x {:g} x {:g} m", room.size_m.x, room.size_m.y, room.size_m.z); }

}  // namespace

std::string engines_markdown(const EngineComparison& comparison) {
  if (comparison.points.empty()) return "";
  std::string rooms;
  for (const ShoeboxRoom& room : comparison.rooms) rooms += (rooms.empty() ? "" : ", ") + room_text(room);
  std::string text = fmt::format(
      "\n## Equal time in boxes of mirrors\n\nRooms of {}; their walls absorb by octave and do not scatter. {} listeners each, one "
      "source. Error: root mean square over rooms and listeners against the sum of the energies of all images. The last three columns "
      "compare with the exact pressure of the same images, which interfere. Engines that add pressures can meet that reference, engines "
      "that render energies on carriers cannot. All values come from one rendered channel of 16 kHz. ms: wall time per response on one "
      "thread, warm, with all work for the source, for the listeners of a room together.\n\n| engine | "
      "setting "
      "| allowed, ms | ms | T20, % |",
      rooms, comparison.rooms.front().listeners_m.size());
  std::string rule = "|---|---|---|---|---|";
  for (const float hz : comparison.rooms.front().bands_hz) text += fmt::format(" T20 {:.0f} Hz |", hz), rule += "---|";
  text += " C50, dB | DRR, dB | to pressure: T20, % | C50, dB | DRR, dB |\n" + rule + "---|---|---|---|---|\n";
  for (const EnginePoint& point : comparison.points) {
    text += fmt::format("| {} | {} | {} | {} | {} |", point.engine, point.setting, point.allowed_ms > 0 ? table_cell(point.allowed_ms) : "",
                        table_cell(point.ms), with_missing(100, point.t20_all));
    for (const ErrorSummary& band : point.t20) text += " " + with_missing(100, band) + " |";
    text +=
        fmt::format(" {} | {} | {} | {} | {} |\n", with_missing(1, point.c50_db), with_missing(1, point.drr_db),
                    with_missing(100, point.pressure_t20), with_missing(1, point.pressure_c50_db), with_missing(1, point.pressure_drr_db));
  }
  for (const std::string& line : comparison.left_out) text += "\n" + line + "\n";
  return text;
}

std::string engines_figure(const EngineComparison& comparison) {
  struct Kind {
    const char *title, *y_label;
    double scale;
    const ErrorSummary EnginePoint::*error;
    PlotLevel heard;
  };
  const Kind kinds[] = {{"Reverberation time", "T20 error, rms %", 100, &EnginePoint::t20_all, {5, "just heard: 5 %"}},
                        {"Early to late energy", "C50 error, rms dB", 1, &EnginePoint::c50_db, {1, "just heard: 1 dB"}}};
  std::vector<PlotPanel> panels;
  for (const Kind& kind : kinds) {
    PlotPanel panel{.title = kind.title, .x_label = "ms per response on one thread", .y_label = kind.y_label, .levels = {kind.heard}};
    std::size_t num_others = 0;
    for (const EnginePoint& point : comparison.points) {
      if (!std::isfinite(point.ms)) {
        panel.levels.push_back({kind.scale * (point.*kind.error).rms, point.engine});
        continue;
      }
      auto series = std::ranges::find(panel.series, point.engine, &PlotSeries::name);
      if (series == panel.series.end()) {
        const bool is_earshot = point.engine.starts_with("earshot,");
        panel.series.push_back({.name = point.engine,
                                .colour = is_earshot ? own_colour(point.engine) : colour_of(num_others++),
                                .marker = is_earshot ? PlotMarker::circle : PlotMarker::star});
        series = std::prev(panel.series.end());
      }
      series->points.push_back({point.ms, kind.scale * (point.*kind.error).rms, kind.scale * (point.*kind.error).rms_error, ""});
    }
    for (PlotSeries& series : panel.series) std::ranges::sort(series.points, {}, &PlotPoint::x);
    panels.push_back(std::move(panel));
  }
  return plot_svg("Equal time in boxes of mirrors", "Against the exact sum of images; one thread, warm", panels, 2);
}

}  // namespace earshot
