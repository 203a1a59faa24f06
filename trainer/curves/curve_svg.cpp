// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/curve_svg.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

struct Series {
  const char* key;
  const char* label;
  const char* colour;
};

std::optional<double> value_of(const CurvePoint& point, const std::string& key) {
  for (const auto& [name, value] : point.values)
    if (name == key && std::isfinite(value)) return value;
  return std::nullopt;
}

void draw_series(SvgDocument& svg, const PlotAxes& axes, const std::vector<CurvePoint>& points, const Series& series) {
  std::vector<SvgPoint> path;
  for (const auto& point : points)
    if (const auto value = value_of(point, series.key)) path.push_back(axes.at(static_cast<double>(point.env_steps), *value));
  svg.polyline(path, {.stroke = series.colour, .stroke_width = 2});
}

}  // namespace

std::string curve_svg(const std::string& title, const std::vector<CurvePoint>& points) {
  double most_steps = 1, low = 0, high = 1;
  for (const auto& point : points) {
    most_steps = std::max(most_steps, static_cast<double>(point.env_steps));
    if (const auto reward = value_of(point, "episodes/reward")) {
      low = std::min(low, std::floor(*reward));
      high = std::max(high, std::ceil(*reward));
    }
  }
  const PlotScale steps{.low = 0, .high = most_steps};
  const PlotAxes fractions{.left = 70, .top = 46, .width = 620, .height = 220, .x_scale = steps, .y_scale = {.low = 0, .high = 1}};
  const PlotAxes rewards{.left = 70, .top = 296, .width = 620, .height = 110, .x_scale = steps, .y_scale = {.low = low, .high = high}};
  SvgDocument svg;
  svg.text({fractions.left, 24}, title, {.size_px = 16});
  std::vector<PlotTick> step_ticks = plot_ticks(steps, 1e-3);
  rewards.draw(svg, step_ticks, plot_ticks(rewards.y_scale));
  for (PlotTick& tick : step_ticks) tick.label.clear();  // both panels have them below the lower one
  fractions.draw(svg, step_ticks, plot_ticks(fractions.y_scale));
  fractions.draw_captions(svg, "", "", "success, SPL");
  rewards.draw_captions(svg, "", "thousand environment steps", "reward");
  double legend_x = fractions.left + 12;
  for (const Series& series : {Series{"episodes/success", "success", "#2a6fdb"}, Series{"episodes/spl", "SPL", "#e07b00"}}) {
    draw_series(svg, fractions, points, series);
    svg.text({legend_x, fractions.top + 18}, series.label, {.colour = series.colour});
    legend_x += 70;
  }
  draw_series(svg, rewards, points, {"episodes/reward", "reward", "#3a9a55"});
  return svg.str(730, 460);
}

}  // namespace earshot
