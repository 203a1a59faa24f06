// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace earshot {

/// Pixels from the upper left corner, y downwards.
struct SvgPoint {
  double x = 0, y = 0;
};

/// Colours in CSS form; "none" draws nothing.  dash: lengths of strokes and gaps, such as "6 4"; empty: a solid line.
struct SvgStyle {
  std::string fill = "none", stroke = "none";
  double stroke_width = 1;
  std::string dash = {};
};

enum class SvgAnchor { start, middle, end };

/// upwards: the text reads from below to above.  halo: a colour drawn behind the letters, so that they stand out from lines; empty: none.
struct SvgTextStyle {
  SvgAnchor anchor = SvgAnchor::start;
  double size_px = 12;
  std::string colour = "#1b1f24";
  bool bold = false, upwards = false;
  std::string halo = {};
};

/// A drawing on white as a self-contained SVG 1.1 document.  Elements lie over those drawn before.  Positions are written to a tenth of a
/// pixel; they must be finite.  Texts and colours are UTF-8; what XML reserves is escaped, a control character becomes U+FFFD.
class SvgDocument {
 public:
  void rectangle(SvgPoint top_left, double width, double height, const SvgStyle& style);
  void line(SvgPoint from, SvgPoint to, const SvgStyle& style);
  void circle(SvgPoint centre, double radius, const SvgStyle& style);
  /// Nothing for no points.
  void polyline(std::span<const SvgPoint> points, const SvgStyle& style);
  void polygon(std::span<const SvgPoint> points, const SvgStyle& style);
  /// at: the anchor on the base line.
  void text(SvgPoint at, std::string_view text, const SvgTextStyle& style = {});
  /// The document of the elements so far.
  [[nodiscard]] std::string str(double width, double height) const;

 private:
  void points(std::string_view element, std::span<const SvgPoint> points, const SvgStyle& style);
  std::string elements_;
};

}  // namespace earshot
