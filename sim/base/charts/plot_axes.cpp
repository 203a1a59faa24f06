// SPDX-License-Identifier: Apache-2.0
#include "sim/base/charts/plot_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace earshot {
namespace {

constexpr const char *kGround = "#fafbfc", *kFrame = "#8a94a0", *kGrid = "#e1e5ea";
constexpr double kRounding = 1e-9;  ///< of the scale: a tick at its end counts

}  // namespace

double PlotScale::fraction(double value) const {
  const double within = std::clamp(value, low, high);
  return logarithmic ? std::log(within / low) / std::log(high / low) : (within - low) / (high - low);
}

double tick_step(double range) {
  const double decade = std::pow(10.0, std::floor(std::log10(range / 5)));
  for (const double step : {1.0, 2.0, 5.0})
    if (range / (step * decade) <= 6) return step * decade;
  return 10 * decade;
}

std::vector<PlotTick> plot_ticks(const PlotScale& scale, double unit) {
  std::vector<PlotTick> ticks;
  const auto add = [&](double value) { ticks.push_back({.value = value, .label = fmt::format("{:g}", value * unit)}); };
  if (!scale.logarithmic) {
    const double step = tick_step(scale.high - scale.low);
    for (double i = std::ceil(scale.low / step - kRounding) + 0.0; i * step <= scale.high + kRounding * step; ++i) add(i * step);
    return ticks;
  }
  const bool dense = scale.high / scale.low <= 250;
  for (double decade = std::pow(10.0, std::floor(std::log10(scale.low))); decade <= scale.high * (1 + kRounding); decade *= 10)
    for (const double step : {1.0, 2.0, 5.0}) {
      if (step > 1 && !dense) continue;
      const double value = step * decade;
      if (value >= scale.low * (1 - kRounding) && value <= scale.high * (1 + kRounding)) add(value);
    }
  return ticks;
}

void PlotAxes::draw(SvgDocument& svg, const std::vector<PlotTick>& x_ticks, const std::vector<PlotTick>& y_ticks) const {
  svg.rectangle({left, top}, width, height, {.fill = kGround});
  for (const PlotTick& tick : y_ticks) {
    const double at = y(tick.value);
    svg.line({left, at}, {right(), at}, {.stroke = kGrid});
    svg.text({left - 6, at + 4}, tick.label, {.anchor = SvgAnchor::end, .size_px = tick.size_px});
  }
  for (const PlotTick& tick : x_ticks) {
    const double at = x(tick.value);
    svg.line({at, top}, {at, bottom()}, {.stroke = kGrid});
    const std::string_view label = tick.label;
    const std::size_t end = label.find('\n');
    const SvgTextStyle style{.anchor = SvgAnchor::middle, .size_px = tick.size_px};
    svg.text({at, bottom() + 16}, label.substr(0, end), style);
    if (end != std::string_view::npos) svg.text({at, bottom() + 27}, label.substr(end + 1), style);
  }
  svg.rectangle({left, top}, width, height, {.stroke = kFrame});
}

void PlotAxes::draw_captions(SvgDocument& svg, std::string_view title, std::string_view x_label, std::string_view y_label) const {
  if (!title.empty()) svg.text({left, top - 10}, title, {.size_px = 14, .bold = true});
  if (!x_label.empty()) svg.text({left + width / 2, bottom() + 40}, x_label, {.anchor = SvgAnchor::middle});
  if (!y_label.empty()) svg.text({left - 48, top + height / 2}, y_label, {.anchor = SvgAnchor::middle, .upwards = true});
}

}  // namespace earshot
