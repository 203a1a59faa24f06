#include "bench/plot_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

namespace earshot {
namespace {

constexpr double kPanelWidth = 420, kPanelHeight = 300, kGapX = 84, kGapY = 92, kLeft = 74, kTop = 96, kMarker = 4.5;
constexpr double kCharWidth = 5.6, kLineHeight = 12;  // of labels at 10.5 px

std::string escape(const std::string& text) {
  std::string escaped;
  for (const char c : text) escaped += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return escaped;
}

struct Box {
  double x0, y0, x1, y1;
  [[nodiscard]] bool overlaps(const Box& other) const { return x0 < other.x1 && other.x0 < x1 && y0 < other.y1 && other.y0 < y1; }
};

/// A logarithmic axis over whole decades, halves of them where the data allow.
struct LogRange {
  double low = 1, high = 10;
  [[nodiscard]] double share(double value) const { return std::log(std::clamp(value, low, high) / low) / std::log(high / low); }
};

LogRange range_of(const std::vector<double>& values) {
  if (values.empty()) return {};
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
  LogRange range{nice(*smallest * 0.75, true), nice(*largest * 1.33, false)};
  if (range.high < 4 * range.low) range = {range.low / 2, range.high * 2};
  return range;
}

std::vector<double> ticks_of(const LogRange& range) {
  const bool dense = range.high / range.low <= 250;
  std::vector<double> ticks;
  for (double decade = std::pow(10.0, std::floor(std::log10(range.low))); decade <= range.high * 1.0001; decade *= 10)
    for (const double step : {1.0, 2.0, 5.0}) {
      if (step > 1 && !dense) continue;
      const double tick = step * decade;
      if (tick >= range.low * 0.9999 && tick <= range.high * 1.0001) ticks.push_back(tick);
    }
  return ticks;
}

bool shown(const PlotPoint& point, bool log_x) {
  return std::isfinite(point.x) && std::isfinite(point.y) && point.y > 0 && (!log_x || point.x > 0);
}

std::string marker_svg(PlotMarker marker, double x, double y, const std::string& colour) {
  if (marker == PlotMarker::circle)
    return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\" fill=\"{}\" stroke=\"white\"/>\n", x, y, kMarker - 0.7, colour);
  const int corners = marker == PlotMarker::star ? 10 : 4;
  const double size = marker == PlotMarker::star ? 9 : 6.5;
  std::string points;
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * std::numbers::pi * i / corners - std::numbers::pi / 2;
    const double radius = marker == PlotMarker::star && i % 2 == 1 ? 0.42 * size : size;
    points += fmt::format("{:.1f},{:.1f} ", x + radius * std::cos(angle), y + radius * std::sin(angle));
  }
  return fmt::format("<polygon points=\"{}\" fill=\"{}\" stroke=\"white\"/>\n", points, colour);
}

/// One panel with its upper left corner at (left, top).
class PanelDrawing {
 public:
  PanelDrawing(const PlotPanel& panel, double left, double top) : panel_(panel), left_(left), top_(top) {
    std::vector<double> xs, ys;
    for (const PlotSeries& series : panel.series)
      for (const PlotPoint& point : series.points) {
        if (!shown(point, log_x())) continue;
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
    x_range_ = range_of(xs);
    y_range_ = range_of(ys);
  }

  std::string svg() {
    draw_axes();
    for (const PlotLevel& level : panel_.levels) draw_level_line(level);
    for (const PlotSeries& series : panel_.series) draw_series(series);
    for (const PlotSeries& series : panel_.series)
      for (const PlotPoint& point : series.points)
        if (shown(point, log_x())) take(point);
    for (const PlotLevel& level : panel_.levels) draw_level_label(level);
    for (const PlotSeries& series : panel_.series)
      for (const PlotPoint& point : series.points)
        if (shown(point, log_x()) && !point.label.empty()) draw_label(point, series.colour);
    return svg_;
  }

 private:
  [[nodiscard]] bool log_x() const { return panel_.categories.empty(); }
  [[nodiscard]] double x(const PlotPoint& point) const {
    if (log_x()) return left_ + kPanelWidth * x_range_.share(point.x);
    return left_ + kPanelWidth * (point.x + 0.5) / static_cast<double>(panel_.categories.size());
  }
  [[nodiscard]] double y(double value) const { return top_ + kPanelHeight * (1 - y_range_.share(value)); }

  void text(double at_x, double at_y, const std::string& what, const std::string& anchor, const std::string& extra = "") {
    svg_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" {}>{}</text>\n", at_x, at_y, anchor, extra, escape(what));
  }

  void draw_axes() {
    svg_ += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{}\" height=\"{}\" fill=\"#fafbfc\" stroke=\"#8a94a0\"/>\n", left_, top_,
                        kPanelWidth, kPanelHeight);
    text(left_, top_ - 10, panel_.title, "start", "font-size=\"14\" font-weight=\"bold\"");
    for (const double tick : ticks_of(y_range_)) {
      svg_ += fmt::format("<line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#e1e5ea\"/>\n", left_,
                          left_ + kPanelWidth, y(tick), y(tick));
      text(left_ - 6, y(tick) + 4, fmt::format("{:g}", tick), "end");
    }
    if (log_x()) {
      for (const double tick : ticks_of(x_range_)) {
        const double at = left_ + kPanelWidth * x_range_.share(tick);
        svg_ += fmt::format("<line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#e1e5ea\"/>\n", at, at, top_,
                            top_ + kPanelHeight);
        text(at, top_ + kPanelHeight + 16, fmt::format("{:g}", tick), "middle");
      }
    } else {
      for (std::size_t i = 0; i < panel_.categories.size(); ++i) draw_category(i);
    }
    text(left_ + kPanelWidth / 2, top_ + kPanelHeight + 42, panel_.x_label, "middle");
    text(left_ - 48, top_ + kPanelHeight / 2, panel_.y_label, "middle",
         fmt::format("transform=\"rotate(-90 {:.1f} {:.1f})\"", left_ - 48, top_ + kPanelHeight / 2));
  }

  /// In two lines if it has two words.
  void draw_category(std::size_t i) {
    const std::string& name = panel_.categories[i];
    const double at = x({.x = static_cast<double>(i), .y = 1});
    const std::size_t space = panel_.categories.size() > 5 ? name.find(' ') : std::string::npos;
    const std::string size = panel_.categories.size() > 5 ? "font-size=\"9.5\"" : "";
    text(at, top_ + kPanelHeight + 15, name.substr(0, space), "middle", size);
    if (space != std::string::npos) text(at, top_ + kPanelHeight + 26, name.substr(space + 1), "middle", size);
  }

  /// The marker and the error bar of a point, so that no text is written over them.
  void take(const PlotPoint& point) {
    taken_.push_back({x(point) - 6, y(point.y) - 6, x(point) + 6, y(point.y) + 6});
    if (point.y_error > 0)
      taken_.push_back({x(point) - 4, y(point.y + point.y_error), x(point) + 4, y(std::max(point.y - point.y_error, y_range_.low))});
  }
  [[nodiscard]] bool is_free(const Box& box) const {
    const bool inside = box.x0 > left_ && box.x1 < left_ + kPanelWidth && box.y0 > top_ && box.y1 < top_ + kPanelHeight;
    return inside && std::none_of(taken_.begin(), taken_.end(), [&](const Box& other) { return other.overlaps(box); });
  }

  void draw_level_line(const PlotLevel& level) {
    if (level.y < y_range_.low || level.y > y_range_.high) return;
    svg_ += fmt::format("<line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#444\" stroke-dasharray=\"6 4\"/>\n", left_,
                        left_ + kPanelWidth, y(level.y), y(level.y));
  }

  /// At the right end of the line, at the left one or in between, above it or below, wherever there is room.
  void draw_level_label(const PlotLevel& level) {
    if (level.y < y_range_.low || level.y > y_range_.high) return;
    const double width = kCharWidth * static_cast<double>(level.label.size()), room = kPanelWidth - width - 10;
    for (const double share : {1.0, 0.0, 0.85, 0.15, 0.7, 0.3, 0.6, 0.4, 0.5})
      for (const double below : {-4.0, 13.0}) {
        const double x0 = left_ + 5 + share * room, base = y(level.y) + below;
        const Box box{x0, base - kLineHeight + 2, x0 + width, base + 2};
        if (!is_free(box)) continue;
        text(x0, base, level.label, "start", "font-size=\"10.5\" fill=\"#444\"");
        taken_.push_back(box);
        return;
      }
  }

  void draw_series(const PlotSeries& series) {
    std::string path;
    for (const PlotPoint& point : series.points)
      if (shown(point, log_x())) path += fmt::format("{}{:.1f},{:.1f}", path.empty() ? "M" : " L", x(point), y(point.y));
    if (series.line && !path.empty())
      svg_ += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.8\"/>\n", path, series.colour);
    for (const PlotPoint& point : series.points) {
      if (!shown(point, log_x())) continue;
      if (point.y_error > 0) {
        const double low = y(std::max(point.y - point.y_error, y_range_.low)), high = y(point.y + point.y_error);
        svg_ += fmt::format(
            "<path d=\"M{0:.1f},{1:.1f} L{0:.1f},{2:.1f} M{3:.1f},{1:.1f} L{4:.1f},{1:.1f} M{3:.1f},{2:.1f} L{4:.1f},{2:.1f}\" "
            "stroke=\"{5}\" "
            "stroke-width=\"1.1\"/>\n",
            x(point), low, high, x(point) - 3, x(point) + 3, series.colour);
      }
      svg_ += marker_svg(series.marker, x(point), y(point.y), series.colour);
    }
  }

  /// The first place about the point where the label covers no point and no other label; none free: it is left out.
  void draw_label(const PlotPoint& point, const std::string& colour) {
    const double px = x(point), py = y(point.y), width = kCharWidth * static_cast<double>(point.label.size());
    struct Place {
      double dx, dy;
      const char* anchor;
      double shift;  ///< of the box's left edge, in widths
    };
    constexpr std::array<Place, 8> places{{{9, 4, "start", 0},
                                           {0, -10, "middle", -0.5},
                                           {0, 19, "middle", -0.5},
                                           {-9, 4, "end", -1},
                                           {8, -8, "start", 0},
                                           {8, 16, "start", 0},
                                           {-8, -8, "end", -1},
                                           {-8, 16, "end", -1}}};
    for (const Place& place : places) {
      const double x0 = px + place.dx + place.shift * width, y1 = py + place.dy + 2;
      const Box box{x0, y1 - kLineHeight, x0 + width, y1};
      if (!is_free(box)) continue;
      text(px + place.dx, py + place.dy, point.label, place.anchor,
           fmt::format("font-size=\"10.5\" fill=\"{}\" stroke=\"#fafbfc\" stroke-width=\"3\" style=\"paint-order:stroke\"", colour));
      taken_.push_back(box);
      return;
    }
  }

  const PlotPanel& panel_;
  double left_, top_;
  LogRange x_range_, y_range_;
  std::vector<Box> taken_;
  std::string svg_;
};

}  // namespace

std::string plot_svg(const std::string& title, const std::string& subtitle, const std::vector<PlotPanel>& panels, int columns) {
  const auto count = static_cast<int>(panels.size());
  const int in_row = std::max(1, std::min(columns, count)), rows = std::max(1, (count + in_row - 1) / in_row);
  const double width = kLeft + in_row * kPanelWidth + (in_row - 1) * kGapX + 24;

  std::vector<const PlotSeries*> legend;
  for (const PlotPanel& panel : panels)
    for (const PlotSeries& series : panel.series)
      if (!series.points.empty() && std::none_of(legend.begin(), legend.end(), [&](const PlotSeries* s) { return s->name == series.name; }))
        legend.push_back(&series);
  std::string entries;
  double x = kLeft, y = kTop + rows * kPanelHeight + (rows - 1) * kGapY + 66;
  for (const PlotSeries* series : legend) {
    const double entry_width = 34 + 6.6 * static_cast<double>(series->name.size());
    if (x > kLeft && x + entry_width > width - 10) x = kLeft, y += 20;
    entries += marker_svg(series->marker, x + 8, y - 4, series->colour);
    entries += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", x + 20, y, escape(series->name));
    x += entry_width;
  }
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#1b1f24\">\n<rect width=\"100%\" height=\"100%\" "
      "fill=\"white\"/>\n",
      width, y + 18);
  svg += fmt::format("<text x=\"{}\" y=\"28\" font-size=\"17\" font-weight=\"bold\">{}</text>\n", kLeft - 50, escape(title));
  svg += fmt::format("<text x=\"{}\" y=\"48\" fill=\"#57606a\">{}</text>\n", kLeft - 50, escape(subtitle));
  for (int i = 0; i < count; ++i) {
    const double left = kLeft + (i % in_row) * (kPanelWidth + kGapX), top = kTop + (i / in_row) * (kPanelHeight + kGapY);
    svg += PanelDrawing(panels[static_cast<std::size_t>(i)], left, top).svg();
  }
  return svg + entries + "</svg>\n";
}

}  // namespace earshot
