// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "sim/base/charts/svg_document.h"

namespace earshot {

/// The values of an axis from end to end: low < high, and 0 < low on a logarithmic one.
struct PlotScale {
  double low = 0, high = 1;
  bool logarithmic = false;
  /// Where a value lies between the ends, 0 to 1; one beyond an end lies at it.
  [[nodiscard]] double fraction(double value) const;
};

/// label: a line break stands for a second line.
struct PlotTick {
  double value = 0;
  std::string label = {};
  double size_px = 12;
};

/// 1, 2 or 5 times a power of ten, such that at most six of them make `range`.  range: above 0.
double tick_step(double range);
/// The multiples of tick_step on a linear scale, labelled with value * unit; on a logarithmic one powers of ten, and 2 and 5 times them
/// where the scale spans less than 250.
std::vector<PlotTick> plot_ticks(const PlotScale& scale, double unit = 1);

/// An upright box in pixels and the values along its sides, x to the right and y upwards.
struct PlotAxes {
  double left = 0, top = 0, width = 0, height = 0;
  PlotScale x_scale = {}, y_scale = {};

  [[nodiscard]] double right() const { return left + width; }
  [[nodiscard]] double bottom() const { return top + height; }
  [[nodiscard]] double x(double value) const { return left + width * x_scale.fraction(value); }
  [[nodiscard]] double y(double value) const { return top + height * (1 - y_scale.fraction(value)); }
  [[nodiscard]] SvgPoint at(double x_value, double y_value) const { return {x(x_value), y(y_value)}; }

  /// The box, and a grid line with its label for every tick.
  void draw(SvgDocument& svg, const std::vector<PlotTick>& x_ticks, const std::vector<PlotTick>& y_ticks) const;
  /// Above the box, below the labels of x, and left of those of y; nothing for an empty text.
  void draw_captions(SvgDocument& svg, std::string_view title, std::string_view x_label, std::string_view y_label) const;
};

}  // namespace earshot
