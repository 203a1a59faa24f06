#include "trainer/curve_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace earshot {
namespace {

struct Series {
  const char* key;
  const char* label;
  const char* colour;
};

struct Panel {
  double top, height, low, high;
  std::string unit;
  [[nodiscard]] double y(double value) const { return top + height * (1 - (value - low) / (high - low)); }
};

constexpr double kLeft = 70, kWidth = 620;

std::optional<double> value_of(const CurvePoint& point, const std::string& key) {
  for (const auto& [name, value] : point.values)
    if (name == key && std::isfinite(value)) return value;
  return std::nullopt;
}

std::string axes(const Panel& panel, double most_steps, bool labels_below) {
  std::string svg = fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#999\"/>\n", kLeft, panel.top,
                                kWidth, panel.height);
  for (int i = 0; i <= 4; ++i) {
    const double value = panel.low + (panel.high - panel.low) * i / 4;
    svg += fmt::format(
        "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"#eee\"/><text x=\"{3}\" y=\"{4:.1f}\" "
        "text-anchor=\"end\">{5:.3g}</text>\n",
        kLeft, kLeft + kWidth, panel.y(value), kLeft - 8, panel.y(value) + 4, value);
  }
  svg += fmt::format("<text transform=\"translate(18 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                     panel.top + panel.height / 2, panel.unit);
  if (labels_below)
    for (int i = 0; i <= 5; ++i)
      svg += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{:.3g}</text>\n", kLeft + kWidth * i / 5,
                         panel.top + panel.height + 18, most_steps * i / 5 / 1000);
  return svg;
}

std::string polyline(const Panel& panel, const std::vector<CurvePoint>& points, const Series& series, double most_steps) {
  std::string path;
  for (const auto& point : points)
    if (const auto value = value_of(point, series.key))
      path += fmt::format("{:.1f},{:.1f} ", kLeft + kWidth * static_cast<double>(point.env_steps) / most_steps,
                          panel.y(std::clamp(*value, panel.low, panel.high)));
  return path.empty() ? "" : fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>\n", path, series.colour);
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
  const Panel shares{46, 220, 0, 1, "success, SPL"}, rewards{296, 110, low, high, "reward"};
  const std::vector<Series> lines{{"episodes/success", "success", "#2a6fdb"}, {"episodes/spl", "SPL", "#e07b00"}};
  std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"730\" height=\"460\" font-family=\"sans-serif\" font-size=\"12\" "
      "fill=\"#333\">\n<rect width=\"730\" height=\"460\" fill=\"#fff\"/>\n";
  svg += fmt::format("<text x=\"{}\" y=\"24\" font-size=\"16\">{}</text>\n", kLeft, title);
  svg += axes(shares, most_steps, false) + axes(rewards, most_steps, true);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    svg += polyline(shares, points, lines[i], most_steps);
    svg += fmt::format("<text x=\"{}\" y=\"64\" fill=\"{}\">{}</text>\n", kLeft + 12 + 70 * static_cast<double>(i), lines[i].colour,
                       lines[i].label);
  }
  svg += polyline(rewards, points, {"episodes/reward", "reward", "#3a9a55"}, most_steps);
  svg += fmt::format("<text x=\"{}\" y=\"446\" text-anchor=\"middle\">thousand environment steps</text>\n</svg>\n", kLeft + kWidth / 2);
  return svg;
}

}  // namespace earshot
