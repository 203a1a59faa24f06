#include "bench/soak/soak_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "bench/soak/soak_report.h"

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

/// 1, 2 or 5 times a power of ten, about a fifth of `range`.
double tick_step(double range) {
  const double decade = std::pow(10.0, std::floor(std::log10(std::max(range, 1e-12) / 5)));
  for (const double step : {1.0, 2.0, 5.0})
    if (range / (step * decade) <= 6) return step * decade;
  return 10 * decade;
}

class PanelDrawing {
 public:
  PanelDrawing(const Panel& panel, double left, double top) : panel_(panel), left_(left), top_(top) {
    double lowest = 1e300;
    for (const Line& line : panel.lines)
      for (const auto& [x, y] : line.points) {
        x_high_ = std::max(x_high_, x);
        y_high_ = std::max(y_high_, y);
        if (y > 0) lowest = std::min(lowest, y);
      }
    if (!panel.names.empty()) x_low_ = -0.3, x_high_ = static_cast<double>(panel.names.size()) - 0.7;
    if (!(x_high_ > x_low_)) x_high_ = x_low_ + 1;
    if (panel.log_y) {
      y_low_ = std::pow(10.0, std::floor(std::log10(std::min(lowest, 1e6))));
      y_high_ = std::pow(10.0, std::ceil(std::log10(std::max(y_high_, 10 * y_low_))));
    } else {
      y_high_ = y_high_ > 0 ? 1.08 * y_high_ : 1.0;
    }
  }

  std::string svg() {
    svg_ += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{}\" height=\"{}\" fill=\"#fafbfc\" stroke=\"#8a94a0\"/>\n", left_, top_,
                        kPanelWidth, kPanelHeight);
    text(left_, top_ - 10, panel_.title, "start", "font-size=\"14\" font-weight=\"bold\"");
    draw_ticks();
    text(left_ + kPanelWidth / 2, top_ + kPanelHeight + 38, panel_.x_label, "middle");
    text(left_ - 50, top_ + kPanelHeight / 2, panel_.y_label, "middle",
         fmt::format("transform=\"rotate(-90 {:.1f} {:.1f})\"", left_ - 50, top_ + kPanelHeight / 2));
    for (const Line& line : panel_.lines) draw_line(line);
    draw_names();
    return svg_;
  }

 private:
  [[nodiscard]] double x(double value) const { return left_ + kPanelWidth * (value - x_low_) / (x_high_ - x_low_); }
  [[nodiscard]] double y(double value) const {
    const double share = panel_.log_y ? std::log(std::max(value, y_low_) / y_low_) / std::log(y_high_ / y_low_) : value / y_high_;
    return top_ + kPanelHeight * (1 - std::clamp(share, 0.0, 1.0));
  }
  void text(double at_x, double at_y, const std::string& what, const std::string& anchor, const std::string& extra = "") {
    svg_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" {}>{}</text>\n", at_x, at_y, anchor, extra, what);
  }
  void y_tick(double value) {
    svg_ += fmt::format("<line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#e1e5ea\"/>\n", left_, left_ + kPanelWidth,
                        y(value), y(value));
    text(left_ - 6, y(value) + 4, fmt::format("{:g}", value), "end");
  }
  void draw_ticks() {
    if (panel_.log_y)
      for (double decade = y_low_; decade <= y_high_ * 1.0001; decade *= 10) y_tick(decade);
    else
      for (int i = 0; i * tick_step(y_high_) <= y_high_; ++i) y_tick(i * tick_step(y_high_));
    if (panel_.names.empty())
      for (int i = 0; i * tick_step(x_high_) <= x_high_; ++i)
        text(x(i * tick_step(x_high_)), top_ + kPanelHeight + 17, fmt::format("{:g}", i * tick_step(x_high_)), "middle");
    for (std::size_t i = 0; i < panel_.names.size(); ++i)
      text(x(static_cast<double>(i)), top_ + kPanelHeight + 17, panel_.names[i], "middle");
  }
  void draw_line(const Line& line) {
    std::string path;
    for (const auto& [at_x, at_y] : line.points) path += fmt::format("{}{:.1f},{:.1f}", path.empty() ? "M" : " L", x(at_x), y(at_y));
    if (path.empty()) return;
    svg_ += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.7\"{}/>\n", path, line.colour,
                        line.dashed ? " stroke-dasharray=\"7 4\"" : "");
    if (!line.marked) return;
    for (const auto& [at_x, at_y] : line.points)
      svg_ += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3\" fill=\"{}\" stroke=\"white\"/>\n", x(at_x), y(at_y), line.colour);
  }
  /// Names of the lines, right of the panel at their last points, moved apart where they would touch.
  void draw_names() {
    std::vector<std::pair<double, const Line*>> at;
    for (const Line& line : panel_.lines)
      if (!line.points.empty()) at.emplace_back(y(line.points.back().second), &line);
    std::ranges::sort(at);
    double last = -1e9;
    for (const auto& [wanted, line] : at) {
      last = std::max(wanted + 4, last + 14);
      text(left_ + kPanelWidth + 8, last, line->name, "start", fmt::format("fill=\"{}\" font-size=\"11\"", line->colour));
    }
  }

  const Panel& panel_;
  double left_, top_;
  double x_low_ = 0, x_high_ = 0, y_low_ = 0, y_high_ = 0;
  std::string svg_;
};

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
              .x_label = "share of the steps that took less",
              .y_label = "ms"};
  panel.log_y = true;
  for (const SoakQuantile& quantile : kSoakQuantiles) panel.names.emplace_back(quantile.name);
  for (std::size_t stage = 0; stage < kSoakStages.size(); ++stage) {
    const LogHistogram& times = result.stage_ms[stage];
    if (times.count() == 0) continue;
    Line line{.name = stage == 0 ? "step (wall)" : kSoakStages[stage], .colour = kColours[stage], .marked = true};
    for (std::size_t i = 0; i < kSoakQuantiles.size(); ++i) {
      const double ms = quantile_of(times, kSoakQuantiles[i]);
      if (ms > 1e-5) line.points.emplace_back(static_cast<double>(i), ms);  // most steps reset nobody
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
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#1b1f24\">\n<rect width=\"100%\" height=\"100%\" "
      "fill=\"white\"/>\n<text x=\"20\" y=\"28\" font-size=\"17\" font-weight=\"bold\">Soak: {2} agent steps, {3} scenes, {4} "
      "episodes</text>\n"
      "<text x=\"20\" y=\"48\" fill=\"#57606a\">{5} agents, {6} threads, {7:.1f} min, {8:.0f} steps/s, {9:.0f} steps per second of "
      "processor"
      "</text>\n",
      width, height, result.steps, result.options.scenes, result.episodes, result.options.num_envs, result.threads, result.seconds / 60,
      static_cast<double>(result.steps) / std::max(result.seconds, 1e-9),
      static_cast<double>(result.steps) / std::max(result.cpu_seconds, 1e-9));
  for (std::size_t i = 0; i < panels.size(); ++i)
    svg += PanelDrawing(panels[i], kLeft + static_cast<double>(i % 2) * (kPanelWidth + kGapX),
                        kTop + static_cast<double>(i / 2) * (kPanelHeight + kGapY))
               .svg();
  return svg + "</svg>\n";
}

}  // namespace earshot
