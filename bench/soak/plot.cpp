// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "bench/soak/report.h"
#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

constexpr double kPanelWidth = 430, kPanelHeight = 250, kLeft = 70, kTop = 84, kGapX = 190, kGapY = 84;
constexpr std::array<const char*, 8> kColours{"#1b1f24", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a4fbf"};

struct Line {
  std::string name, colour;
  std::vector<std::pair<double, double>> points = {};
  bool dashed = false, marked = false;
};

/// One pair of axes.  x is linear, or names at 0, 1, ...; y is linear from 0, or logarithmic.
struct Panel {
  std::string title, x_label, y_label;
  std::vector<std::string> names = {};
  bool log_y = false;
  std::vector<Line> lines = {};
};

PlotAxes axes_of(const Panel& panel, double left, double top) {
  double x_high = 0, y_high = 0, lowest = 1e6;
  for (const Line& line : panel.lines)
    for (const auto& [x, y] : line.points) {
      x_high = std::max(x_high, x);
      y_high = std::max(y_high, y);
      if (y > 0) lowest = std::min(lowest, y);
    }
  PlotAxes axes{.left = left, .top = top, .width = kPanelWidth, .height = kPanelHeight};
  if (!panel.names.empty())
    axes.x_scale = {.low = -0.3, .high = static_cast<double>(panel.names.size()) - 0.7};
  else
    axes.x_scale.high = x_high > 0 ? x_high : 1.0;
  if (panel.log_y) {
    const double low = std::pow(10.0, std::floor(std::log10(lowest)));
    axes.y_scale = {.low = low, .high = std::pow(10.0, std::ceil(std::log10(std::max(y_high, 10 * low)))), .logarithmic = true};
  } else {
    axes.y_scale.high = y_high > 0 ? 1.08 * y_high : 1.0;
  }
  return axes;
}

void draw_line(SvgDocument& svg, const PlotAxes& axes, const Line& line) {
  std::vector<SvgPoint> path;
  for (const auto& [x, y] : line.points) path.push_back(axes.at(x, y));
  svg.polyline(path, {.stroke = line.colour, .stroke_width = 1.7, .dash = line.dashed ? "7 4" : ""});
  if (!line.marked) return;
  for (const SvgPoint point : path) svg.circle(point, 3, {.fill = line.colour, .stroke = "white"});
}

/// Names of the lines, right of the panel at their last points, moved apart where they would touch.
void draw_names(SvgDocument& svg, const PlotAxes& axes, const Panel& panel) {
  std::vector<std::pair<double, const Line*>> ends;
  for (const Line& line : panel.lines)
    if (!line.points.empty()) ends.emplace_back(axes.y(line.points.back().second), &line);
  std::ranges::sort(ends);
  double last = -1e9;
  for (const auto& [end, line] : ends) {
    last = std::max(end + 4, last + 14);
    svg.text({axes.right() + 8, last}, line->name, {.size_px = 11, .colour = line->colour});
  }
}

void draw_panel(SvgDocument& svg, const Panel& panel, double left, double top) {
  const PlotAxes axes = axes_of(panel, left, top);
  std::vector<PlotTick> x_ticks;
  for (std::size_t i = 0; i < panel.names.size(); ++i) x_ticks.push_back({.value = static_cast<double>(i), .label = panel.names[i]});
  axes.draw(svg, panel.names.empty() ? plot_ticks(axes.x_scale) : x_ticks, plot_ticks(axes.y_scale));
  axes.draw_captions(svg, panel.title, panel.x_label, panel.y_label);
  for (const Line& line : panel.lines) draw_line(svg, axes, line);
  draw_names(svg, axes, panel);
}

Panel memory_panel(const SoakResult& result) {
  Panel panel{.title = "Memory", .x_label = "agent steps, thousands", .y_label = "MiB"};
  const auto line = [&](const char* name, const char* colour, double MemorySample::*value) {
    Line drawn{.name = name, .colour = colour};
    for (const MemorySample& sample : result.memory) drawn.points.emplace_back(1e-3 * static_cast<double>(sample.steps), sample.*value);
    panel.lines.push_back(std::move(drawn));
  };
  line("resident", kColours[0], &MemorySample::resident);
  line("heap in use", kColours[1], &MemorySample::heap_in_use);
  line("scene cache", kColours[3], &MemorySample::cache);
  const Slope& fit = result.resident_slope;
  if (fit.points >= 3) {
    Line drawn{.name = fmt::format("{:+.2f} MiB per 100,000", 1e5 * fit.per_x), .colour = kColours[2], .dashed = true};
    for (const std::uint64_t steps : {result.warm_up_steps, result.steps})
      drawn.points.emplace_back(1e-3 * static_cast<double>(steps), fit.intercept + fit.per_x * static_cast<double>(steps));
    panel.lines.push_back(std::move(drawn));
  }
  return panel;
}

Panel time_panel(const SoakResult& result) {
  Panel panel{.title = fmt::format("One step of {} agents, by stage", result.options.num_envs),
              .x_label = "fraction of the steps that took less",
              .y_label = "ms"};
  panel.log_y = true;
  for (const SoakQuantile& quantile : kSoakQuantiles) panel.names.emplace_back(quantile.name);
  for (std::size_t stage = 0; stage < kSoakStages.size(); ++stage) {
    const LogHistogram& times = result.stage_ms[stage];
    if (times.count() == 0) continue;
    Line line{.name = stage == 0 ? "step (wall)" : kSoakStages[stage], .colour = kColours[stage], .marked = true};
    for (std::size_t i = 0; i < kSoakQuantiles.size(); ++i) {
      const double ms = quantile_of(times, kSoakQuantiles[i]);
      if (ms > 1e-5) line.points.emplace_back(static_cast<double>(i), ms);  // most steps reset no agent
    }
    panel.lines.push_back(std::move(line));
  }
  return panel;
}

Panel count_panel(const SoakResult& result, const char* title, const char* name, std::uint64_t MemorySample::*value) {
  Panel panel{.title = title, .x_label = "minutes", .y_label = "count"};
  Line line{.name = name, .colour = kColours[1]};
  for (const MemorySample& sample : result.memory) line.points.emplace_back(sample.seconds / 60, static_cast<double>(sample.*value));
  panel.lines.push_back(std::move(line));
  return panel;
}

}  // namespace

std::string soak_svg(const SoakResult& result) {
  Panel scenes = count_panel(result, "Scenes", "loaded", &MemorySample::scenes_loaded);
  Panel held = count_panel(result, "", "held", &MemorySample::scenes_held);
  held.lines.front().colour = kColours[2];
  scenes.lines.push_back(std::move(held.lines.front()));
  const std::array<Panel, 4> panels{memory_panel(result), time_panel(result),
                                    count_panel(result, "Episodes", "finished", &MemorySample::episodes), std::move(scenes)};
  const double width = kLeft + 2 * kPanelWidth + 2 * kGapX - 20, height = kTop + 2 * kPanelHeight + kGapY + 56;
  SvgDocument svg;
  svg.text({20, 28}, fmt::format("Soak: {} agent steps, {} scenes, {} episodes", result.steps, result.options.scenes, result.episodes),
           {.size_px = 17, .bold = true});
  svg.text({20, 48},
           fmt::format("{} agents, {} threads, {:.1f} min, {:.0f} steps/s, {:.0f} steps per second of processor", result.options.num_envs,
                       result.threads, result.seconds / 60, static_cast<double>(result.steps) / std::max(result.seconds, 1e-9),
                       static_cast<double>(result.steps) / std::max(result.cpu_seconds, 1e-9)),
           {.colour = "#57606a"});
  for (std::size_t i = 0; i < panels.size(); ++i)
    draw_panel(svg, panels[i], kLeft + static_cast<double>(i % 2) * (kPanelWidth + kGapX),
               kTop + static_cast<double>(i / 2) * (kPanelHeight + kGapY));
  return svg.str(width, height);
}

}  // namespace earshot
