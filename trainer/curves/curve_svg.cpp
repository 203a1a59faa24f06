// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/curve_svg.h"

#include <algorithm>
#include <cmath>
#include <iterator>
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

/// Of either way of acting; bands of both lie below the lines.
constexpr Series kHeldOut[] = {{"held_out/argmax_success", "held-out, argmax", "#b03a8c"},
                               {"held_out/sample_success", "sampled", "#6b5bd2"}};
constexpr const char* kBands[] = {"#f0d3e6", "#dedaf6"};

void draw_interval(SvgDocument& svg, const PlotAxes& axes, const std::vector<CurvePoint>& points, const std::string& key,
                   const char* colour) {
  std::vector<SvgPoint> outline, back;
  for (const auto& point : points) {
    const auto low = value_of(point, key + "_low"), high = value_of(point, key + "_high");
    if (!low || !high) continue;
    outline.push_back(axes.at(static_cast<double>(point.env_steps), *high));
    back.push_back(axes.at(static_cast<double>(point.env_steps), *low));
  }
  if (outline.empty()) return;
  outline.insert(outline.end(), back.rbegin(), back.rend());
  svg.polygon(outline, {.fill = colour});
}

/// The success that best.ckpt was chosen by.
void draw_best(SvgDocument& svg, const PlotAxes& axes, const std::vector<CurvePoint>& points) {
  std::optional<double> update, success;
  for (const auto& point : points)
    if (const auto best = value_of(point, "held_out/best_update")) {
      update = best;
      success = value_of(point, "held_out/best_success");
    }
  if (!update || !success) return;
  for (const auto& point : points)
    if (static_cast<double>(point.update) == *update && is_of_held_out(point)) {
      svg.circle(axes.at(static_cast<double>(point.env_steps), *success), 5, {.stroke = "#1b1f24", .stroke_width = 1.5});
      return;
    }
}

void draw_held_out(SvgDocument& svg, const PlotAxes& axes, const std::vector<CurvePoint>& points, double legend_x) {
  if (std::ranges::none_of(points, is_of_held_out)) return;
  for (std::size_t i = 0; i < std::size(kHeldOut); ++i) draw_interval(svg, axes, points, kHeldOut[i].key, kBands[i]);
  for (const Series& series : kHeldOut) {
    draw_series(svg, axes, points, series);
    svg.text({legend_x, axes.top + 18}, series.label, {.colour = series.colour});
    legend_x += 120;
  }
  draw_best(svg, axes, points);
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
  constexpr double first_x = 12, entry = 70;
  double legend_x = fractions.left + first_x;
  draw_held_out(svg, fractions, points, legend_x + 2 * entry);
  for (const Series& series : {Series{"episodes/success", "success", "#2a6fdb"}, Series{"episodes/spl", "SPL", "#e07b00"}}) {
    draw_series(svg, fractions, points, series);
    svg.text({legend_x, fractions.top + 18}, series.label, {.colour = series.colour});
    legend_x += entry;
  }
  draw_series(svg, rewards, points, {"episodes/reward", "reward", "#3a9a55"});
  return svg.str(730, 460);
}

}  // namespace earshot
