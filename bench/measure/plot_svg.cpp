// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/plot_svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

constexpr double kPanelWidth = 420, kPanelHeight = 300, kGapX = 84, kGapY = 92, kLeft = 74, kTop = 96;
constexpr double kLabelPx = 10.5, kCharWidth = 5.6, kLineHeight = 12;
constexpr const char* kLevelColour = "#444";

struct Box {
  double x0, y0, x1, y1;
  [[nodiscard]] bool overlaps(const Box& other) const { return x0 < other.x1 && other.x0 < x1 && y0 < other.y1 && other.y0 < y1; }
};

/// A logarithmic scale whose ends are 1, 2 or 5 times a power of ten, with a margin about the values.
PlotScale scale_of(const std::vector<double>& values) {
  PlotScale scale{.low = 1, .high = 10, .logarithmic = true};
  if (values.empty()) return scale;
  const auto [smallest, largest] = std::minmax_element(values.begin(), values.end());
  const auto nice = [](double value, bool down) {
    const double decade = std::pow(10.0, std::floor(std::log10(value)));
    const std::array<double, 4> steps{1, 2, 5, 10};
    double best = down ? decade : 10 * decade;
    for (const double step : steps)
      if (down ? step * decade <= value : step * decade >= value) {
        best = down ? std::max(best, step * decade) : std::min(best, step * decade);
      }
    return best;
  };
  scale.low = nice(*smallest * 0.75, true);
  scale.high = nice(*largest * 1.33, false);
  if (scale.high < 4 * scale.low) {
    scale.low /= 2;
    scale.high *= 2;
  }
  return scale;
}

bool is_shown(const PlotPoint& point, bool log_x) {
  return std::isfinite(point.x) && std::isfinite(point.y) && point.y > 0 && (!log_x || point.x > 0);
}

void draw_marker(SvgDocument& svg, PlotMarker marker, SvgPoint at, const std::string& colour) {
  const SvgStyle style{.fill = colour, .stroke = "white"};
  if (marker == PlotMarker::circle) return svg.circle(at, 3.8, style);
  const int corners = marker == PlotMarker::star ? 10 : 4;
  const double size = marker == PlotMarker::star ? 9 : 6.5;
  std::vector<SvgPoint> points;
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * std::numbers::pi * i / corners - std::numbers::pi / 2;
    const double radius = marker == PlotMarker::star && i % 2 == 1 ? 0.42 * size : size;
    points.push_back({at.x + radius * std::cos(angle), at.y + radius * std::sin(angle)});
  }
  svg.polygon(points, style);
}

/// One panel with its upper left corner at (left, top).
class PanelDrawing {
 public:
  PanelDrawing(SvgDocument& svg, const PlotPanel& panel, double left, double top)
      : svg_(svg), panel_(panel), axes_{.left = left, .top = top, .width = kPanelWidth, .height = kPanelHeight} {
    std::vector<double> xs, ys;
    for (const PlotSeries& series : panel.series)
      for (const PlotPoint& point : series.points) {
        if (!is_shown(point, log_x())) continue;
        xs.push_back(point.x);
        ys.push_back(point.y);
        if (point.y_error > 0) ys.push_back(point.y + point.y_error);
        if (point.y_error > 0) ys.push_back(std::max(point.y - point.y_error, point.y / 3));
      }
    if (!ys.empty()) {
      const double lowest = *std::min_element(ys.begin(), ys.end()), highest = *std::max_element(ys.begin(), ys.end());
      for (const PlotLevel& level : panel.levels)  // a level far from all points would only squeeze them
        if (level.y > lowest / 3 && level.y < highest * 3) ys.push_back(level.y);
    }
    axes_.x_scale = log_x() ? scale_of(xs) : PlotScale{.low = -0.5, .high = static_cast<double>(panel.categories.size()) - 0.5};
    axes_.y_scale = scale_of(ys);
  }

  void draw() {
    axes_.draw(svg_, log_x() ? plot_ticks(axes_.x_scale) : category_ticks(), plot_ticks(axes_.y_scale));
    axes_.draw_captions(svg_, panel_.title, panel_.x_label, panel_.y_label);
    for (const PlotLevel& level : panel_.levels) draw_level_line(level);
    for (const PlotSeries& series : panel_.series) draw_series(series);
    for (const PlotSeries& series : panel_.series)
      for (const PlotPoint& point : series.points)
        if (is_shown(point, log_x())) take(point);
    for (const PlotLevel& level : panel_.levels) draw_level_label(level);
    for (const PlotSeries& series : panel_.series)
      for (const PlotPoint& point : series.points)
        if (is_shown(point, log_x()) && !point.label.empty()) draw_label(point, series.colour);
  }

 private:
  [[nodiscard]] bool log_x() const { return panel_.categories.empty(); }
  [[nodiscard]] double low_end(const PlotPoint& point) const { return std::max(point.y - point.y_error, axes_.y_scale.low); }

  /// Where there are many: small, and a name of two words in two lines.
  [[nodiscard]] std::vector<PlotTick> category_ticks() const {
    const bool crowded = panel_.categories.size() > 5;
    std::vector<PlotTick> ticks;
    for (std::size_t i = 0; i < panel_.categories.size(); ++i) {
      std::string name = panel_.categories[i];
      const std::size_t space = crowded ? name.find(' ') : std::string::npos;
      if (space != std::string::npos) name[space] = '\n';
      ticks.push_back({.value = static_cast<double>(i), .label = std::move(name), .size_px = crowded ? 9.5 : 12});
    }
    return ticks;
  }

  /// The marker and the error bar of a point, so that no text is written over them.
  void take(const PlotPoint& point) {
    const SvgPoint at = axes_.at(point.x, point.y);
    taken_.push_back({at.x - 6, at.y - 6, at.x + 6, at.y + 6});
    if (point.y_error > 0) taken_.push_back({at.x - 4, axes_.y(point.y + point.y_error), at.x + 4, axes_.y(low_end(point))});
  }
  [[nodiscard]] bool is_free(const Box& box) const {
    const bool inside = box.x0 > axes_.left && box.x1 < axes_.right() && box.y0 > axes_.top && box.y1 < axes_.bottom();
    return inside && std::none_of(taken_.begin(), taken_.end(), [&](const Box& other) { return other.overlaps(box); });
  }

  [[nodiscard]] bool is_within(const PlotLevel& level) const { return level.y >= axes_.y_scale.low && level.y <= axes_.y_scale.high; }
  void draw_level_line(const PlotLevel& level) {
    if (!is_within(level)) return;
    svg_.line({axes_.left, axes_.y(level.y)}, {axes_.right(), axes_.y(level.y)}, {.stroke = kLevelColour, .dash = "6 4"});
  }

  /// At the right end of the line, at the left one or in between, above it or below: at the first free place.
  void draw_level_label(const PlotLevel& level) {
    if (!is_within(level)) return;
    const double width = kCharWidth * static_cast<double>(level.label.size()), space = kPanelWidth - width - 10;
    for (const double fraction : {1.0, 0.0, 0.85, 0.15, 0.7, 0.3, 0.6, 0.4, 0.5})
      for (const double below : {-4.0, 13.0}) {
        const double x0 = axes_.left + 5 + fraction * space, base = axes_.y(level.y) + below;
        const Box box{x0, base - kLineHeight + 2, x0 + width, base + 2};
        if (!is_free(box)) continue;
        svg_.text({x0, base}, level.label, {.size_px = kLabelPx, .colour = kLevelColour});
        taken_.push_back(box);
        return;
      }
  }

  void draw_series(const PlotSeries& series) {
    std::vector<SvgPoint> path;
    for (const PlotPoint& point : series.points)
      if (is_shown(point, log_x())) path.push_back(axes_.at(point.x, point.y));
    if (series.line) svg_.polyline(path, {.stroke = series.colour, .stroke_width = 1.8});
    for (const PlotPoint& point : series.points) {
      if (!is_shown(point, log_x())) continue;
      const SvgPoint at = axes_.at(point.x, point.y);
      if (point.y_error > 0) {
        const double low = axes_.y(low_end(point)), high = axes_.y(point.y + point.y_error);
        const SvgStyle style{.stroke = series.colour, .stroke_width = 1.1};
        svg_.line({at.x, low}, {at.x, high}, style);
        for (const double end : {low, high}) svg_.line({at.x - 3, end}, {at.x + 3, end}, style);
      }
      draw_marker(svg_, series.marker, at, series.colour);
    }
  }

  /// The first place about the point where the label covers no point and no other label; none free: it is left out.
  void draw_label(const PlotPoint& point, const std::string& colour) {
    const double width = kCharWidth * static_cast<double>(point.label.size());
    const SvgPoint at = axes_.at(point.x, point.y);
    struct Place {
      double dx, dy;
      SvgAnchor anchor;
      double shift;  ///< of the box's left edge, in widths
    };
    constexpr std::array<Place, 8> places{{{9, 4, SvgAnchor::start, 0},
                                           {0, -10, SvgAnchor::middle, -0.5},
                                           {0, 19, SvgAnchor::middle, -0.5},
                                           {-9, 4, SvgAnchor::end, -1},
                                           {8, -8, SvgAnchor::start, 0},
                                           {8, 16, SvgAnchor::start, 0},
                                           {-8, -8, SvgAnchor::end, -1},
                                           {-8, 16, SvgAnchor::end, -1}}};
    for (const Place& place : places) {
      const double x0 = at.x + place.dx + place.shift * width, y1 = at.y + place.dy + 2;
      const Box box{x0, y1 - kLineHeight, x0 + width, y1};
      if (!is_free(box)) continue;
      svg_.text({at.x + place.dx, at.y + place.dy}, point.label,
                {.anchor = place.anchor, .size_px = kLabelPx, .colour = colour, .halo = "#fafbfc"});
      taken_.push_back(box);
      return;
    }
  }

  SvgDocument& svg_;
  const PlotPanel& panel_;
  PlotAxes axes_;
  std::vector<Box> taken_;
};

}  // namespace

std::string plot_svg(const std::string& title, const std::string& subtitle, const std::vector<PlotPanel>& panels, int columns) {
  const auto count = static_cast<int>(panels.size());
  const int in_row = std::max(1, std::min(columns, count)), rows = std::max(1, (count + in_row - 1) / in_row);
  const double width = kLeft + in_row * kPanelWidth + (in_row - 1) * kGapX + 24;
  SvgDocument svg;
  svg.text({kLeft - 50, 28}, title, {.size_px = 17, .bold = true});
  svg.text({kLeft - 50, 48}, subtitle, {.colour = "#57606a"});
  for (int i = 0; i < count; ++i) {
    const double left = kLeft + (i % in_row) * (kPanelWidth + kGapX), top = kTop + (i / in_row) * (kPanelHeight + kGapY);
    PanelDrawing(svg, panels[static_cast<std::size_t>(i)], left, top).draw();
  }
  std::vector<const PlotSeries*> legend;
  for (const PlotPanel& panel : panels)
    for (const PlotSeries& series : panel.series)
      if (!series.points.empty() && std::none_of(legend.begin(), legend.end(), [&](const PlotSeries* s) { return s->name == series.name; }))
        legend.push_back(&series);
  double x = kLeft, y = kTop + rows * kPanelHeight + (rows - 1) * kGapY + 66;
  for (const PlotSeries* series : legend) {
    const double entry_width = 34 + 6.6 * static_cast<double>(series->name.size());
    if (x > kLeft && x + entry_width > width - 10) x = kLeft, y += 20;
    draw_marker(svg, series->marker, {x + 8, y - 4}, series->colour);
    svg.text({x + 20, y}, series->name);
    x += entry_width;
  }
  return svg.str(width, y + 18);
}

}  // namespace earshot
