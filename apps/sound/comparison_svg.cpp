// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/comparison_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxCurves = 12, kPerRow = 3;
constexpr double kWidth = 900, kLeft = 70, kPanelTop = 82, kPanelHeight = 200, kCurveHeight = 150, kCurveGap = 62, kLowestDb = -45;
constexpr const char *kMeasured = "#1b1f24", *kSimulated = "#d9480f";
constexpr std::array<const char*, 5> kBandColours{"#4c3a9e", "#2a6fdb", "#2e9a4f", "#c98a00", "#c92a2a"};

using Value = std::optional<double> BandMetrics::*;

const char* colour_of(std::size_t band) { return kBandColours[band % kBandColours.size()]; }

std::vector<double> values_of(const RoomComparison& comparison, Value value) {
  std::vector<double> all;
  for (const ComparedPlace& place : comparison.places)
    for (const std::vector<OctaveDecay>* side : {&place.measured, &place.simulated})
      for (const OctaveDecay& decay : *side)
        if (decay.metrics.*value) all.push_back(*(decay.metrics.*value));
  return all;
}

PlotScale scale_of(const std::vector<double>& values, bool from_zero) {
  if (values.empty()) return {.low = 0, .high = 1};
  const auto [low, high] = std::ranges::minmax_element(values);
  const double step = tick_step(std::max(from_zero ? *high : *high - *low, 1e-3));
  return {.low = from_zero ? 0 : step * std::floor(*low / step - 0.2), .high = step * std::ceil(*high / step + 0.2)};
}

/// Measured values as filled dots, simulated ones beside them as rings.
void draw_values(SvgDocument& svg, const PlotAxes& axes, const RoomComparison& comparison, Value value) {
  const auto count = static_cast<double>(comparison.places.size());
  for (std::size_t p = 0; p < comparison.places.size(); ++p) {
    const ComparedPlace& place = comparison.places[p];
    const double shift = count > 1 ? 0.5 * (static_cast<double>(p) / (count - 1) - 0.5) : 0;
    for (std::size_t b = 0; b < place.measured.size(); ++b) {
      const auto found = std::ranges::find(comparison.bands_hz, place.measured[b].centre_hz);
      const double x = static_cast<double>(found - comparison.bands_hz.begin()) + shift;
      const auto &measured = place.measured[b].metrics.*value, &simulated = place.simulated[b].metrics.*value;
      if (measured && simulated) svg.line(axes.at(x, *measured), axes.at(x, *simulated), {.stroke = "#adb5bd"});
      if (simulated) svg.circle(axes.at(x, *simulated), 3, {.fill = "white", .stroke = kSimulated, .stroke_width = 1.6});
      if (measured) svg.circle(axes.at(x, *measured), 2.6, {.fill = kMeasured});
    }
  }
}

std::vector<PlotTick> band_ticks(const RoomComparison& comparison) {
  std::vector<PlotTick> ticks;
  for (std::size_t b = 0; b < comparison.bands_hz.size(); ++b)
    ticks.push_back({.value = static_cast<double>(b), .label = fmt::format("{:.0f}", comparison.bands_hz[b])});
  return ticks;
}

void draw_panel(SvgDocument& svg, const RoomComparison& comparison, double left, Value value, const std::string& title, bool from_zero) {
  const PlotScale bands{.low = -0.5, .high = static_cast<double>(comparison.bands_hz.size()) - 0.5};
  const PlotAxes axes{.left = left,
                      .top = kPanelTop,
                      .width = 350,
                      .height = kPanelHeight,
                      .x_scale = bands,
                      .y_scale = scale_of(values_of(comparison, value), from_zero)};
  axes.draw(svg, band_ticks(comparison), plot_ticks(axes.y_scale));
  axes.draw_captions(svg, title, "octave, Hz", "");
  draw_values(svg, axes, comparison, value);
}

/// Names of shown places, spread evenly.
std::vector<std::size_t> shown_places(std::size_t count) {
  std::vector<std::size_t> shown;
  const std::size_t number = std::min(count, kMaxCurves);
  for (std::size_t i = 0; i < number; ++i) shown.push_back(number > 1 ? i * (count - 1) / (number - 1) : 0);
  return shown;
}

double end_of(const RoomComparison& comparison) {
  std::size_t longest = 50;
  for (const ComparedPlace& place : comparison.places)
    for (const OctaveDecay& decay : place.measured) {
      const auto end = std::ranges::find_if(decay.level_db, [](double level) { return level < kLowestDb; });
      longest = std::max(longest, static_cast<std::size_t>(end - decay.level_db.begin()));
    }
  return 1e-3 * static_cast<double>(longest);
}

void draw_curves(SvgDocument& svg, const PlotAxes& axes, const ComparedPlace& place) {
  for (const bool is_measured : {true, false}) {
    const std::vector<OctaveDecay>& decays = is_measured ? place.measured : place.simulated;
    for (std::size_t b = 0; b < decays.size(); ++b) {
      std::vector<SvgPoint> points;
      for (std::size_t i = 0; i < decays[b].level_db.size(); ++i) {
        const double time_s = 1e-3 * static_cast<double>(i);
        if (decays[b].level_db[i] < kLowestDb || time_s > axes.x_scale.high) break;
        points.push_back(axes.at(time_s, decays[b].level_db[i]));
      }
      svg.polyline(points, {.stroke = colour_of(b), .stroke_width = 1.4, .dash = is_measured ? "" : "4 3"});
    }
  }
}

}  // namespace

std::string comparison_svg(const std::string& title, const RoomComparison& comparison) {
  SvgDocument svg;
  svg.text({kLeft, 24}, title, {.size_px = 15, .bold = true});
  svg.circle({kLeft + 4, 40}, 2.6, {.fill = kMeasured});
  svg.text({kLeft + 14, 44}, "measured (curves: solid)");
  svg.circle({kLeft + 184, 40}, 3, {.fill = "white", .stroke = kSimulated, .stroke_width = 1.6});
  svg.text({kLeft + 194, 44}, "simulated (curves: dashed)");
  draw_panel(svg, comparison, kLeft, &BandMetrics::t20_s, "decay time T20, s", true);
  draw_panel(svg, comparison, kLeft + 430, &BandMetrics::drr_db, "direct-to-reverberant ratio, dB", false);

  const double legend_y = kPanelTop + kPanelHeight + 62;
  double x = kLeft;
  svg.text({x, legend_y}, "decay curves, dB over seconds:");
  x += 200;
  for (std::size_t b = 0; b < comparison.bands_hz.size(); ++b, x += 80) {
    svg.line({x, legend_y - 4}, {x + 16, legend_y - 4}, {.stroke = colour_of(b), .stroke_width = 2});
    svg.text({x + 20, legend_y}, fmt::format("{:.0f} Hz", comparison.bands_hz[b]));
  }
  const PlotScale times{.low = 0, .high = end_of(comparison)}, levels{.low = kLowestDb, .high = 0};
  const std::vector<std::size_t> shown = shown_places(comparison.places.size());
  for (std::size_t i = 0; i < shown.size(); ++i) {
    const PlotAxes axes{.left = kLeft + static_cast<double>(i % kPerRow) * 280,
                        .top = legend_y + 34 + static_cast<double>(i / kPerRow) * (kCurveHeight + kCurveGap),
                        .width = 220,
                        .height = kCurveHeight,
                        .x_scale = times,
                        .y_scale = levels};
    const ComparedPlace& place = comparison.places[shown[i]];
    axes.draw(svg, plot_ticks(times), plot_ticks(levels));
    const std::string name = place.name.size() > 24 ? "..." + place.name.substr(place.name.size() - 21) : place.name;
    svg.text({axes.left, axes.top - 6}, fmt::format("{}, {:.1f} m", name, place.distance_m), {.size_px = 11});
    draw_curves(svg, axes, place);
  }
  const double rows = std::ceil(static_cast<double>(shown.size()) / kPerRow);
  return svg.str(kWidth, legend_y + 34 + rows * (kCurveHeight + kCurveGap));
}

}  // namespace earshot
