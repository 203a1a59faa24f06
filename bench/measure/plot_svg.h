// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace earshot {

/// A point with the standard error of y; 0 or NaN: none drawn.
struct PlotPoint {
  double x = 0, y = 0, y_error = 0;
  std::string label = {};
};

enum class PlotMarker { circle, diamond, star };

struct PlotSeries {
  std::string name;  ///< in the legend; one entry for the same name in several panels, which should have one colour
  std::string colour;
  PlotMarker marker = PlotMarker::circle;
  bool line = true;
  std::vector<PlotPoint> points = {};
};

/// A horizontal line with a name, such as a threshold of hearing.
struct PlotLevel {
  double y = 0;
  std::string label;
};

/// One pair of axes.  y is logarithmic.  x is too, or, with categories, point x = 0, 1, ... stands at the n-th of them.
struct PlotPanel {
  std::string title, x_label, y_label;
  std::vector<std::string> categories = {};
  std::vector<PlotSeries> series = {};
  std::vector<PlotLevel> levels = {};
};

/// A drawing of the panels in rows of `columns`, with one legend.  Points that are not finite or not above 0 are left out.
std::string plot_svg(const std::string& title, const std::string& subtitle, const std::vector<PlotPanel>& panels, int columns);

}  // namespace earshot
