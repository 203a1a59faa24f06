// SPDX-License-Identifier: Apache-2.0
#include "sim/base/charts/svg_document.h"

#include <fmt/format.h>

#include <array>

#include "sim/base/text/markup.h"

namespace earshot {
namespace {

/// XML 1.0 has no form for most control characters.
std::string escape(std::string_view text) {
  std::string printable;
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      printable += "\xEF\xBF\xBD";
    else
      printable += c;
  }
  return escape_markup(printable);
}

std::string attributes(const SvgStyle& style) {
  std::string text = fmt::format("fill=\"{}\"", escape(style.fill));
  if (style.stroke != "none") text += fmt::format(" stroke=\"{}\" stroke-width=\"{:g}\"", escape(style.stroke), style.stroke_width);
  if (!style.dash.empty()) text += fmt::format(" stroke-dasharray=\"{}\"", escape(style.dash));
  return text;
}

}  // namespace

void SvgDocument::rectangle(SvgPoint top_left, double width, double height, const SvgStyle& style) {
  elements_ += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" {}/>\n", top_left.x, top_left.y, width,
                           height, attributes(style));
}

void SvgDocument::line(SvgPoint from, SvgPoint to, const SvgStyle& style) {
  elements_ +=
      fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", from.x, from.y, to.x, to.y, attributes(style));
}

void SvgDocument::circle(SvgPoint centre, double radius, const SvgStyle& style) {
  elements_ += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:.1f}\" {}/>\n", centre.x, centre.y, radius, attributes(style));
}

void SvgDocument::polyline(std::span<const SvgPoint> points, const SvgStyle& style) { this->points("polyline", points, style); }

void SvgDocument::polygon(std::span<const SvgPoint> points, const SvgStyle& style) { this->points("polygon", points, style); }

void SvgDocument::points(std::string_view element, std::span<const SvgPoint> points, const SvgStyle& style) {
  if (points.empty()) return;
  elements_ += fmt::format("<{} points=\"", element);
  for (std::size_t i = 0; i < points.size(); ++i) elements_ += fmt::format("{}{:.1f},{:.1f}", i == 0 ? "" : " ", points[i].x, points[i].y);
  elements_ += fmt::format("\" {}/>\n", attributes(style));
}

void SvgDocument::text(SvgPoint at, std::string_view text, const SvgTextStyle& style) {
  constexpr std::array<const char*, 3> anchors{"start", "middle", "end"};
  elements_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{:g}\" fill=\"{}\"", at.x, at.y,
                           anchors[static_cast<std::size_t>(style.anchor)], style.size_px, escape(style.colour));
  if (style.bold) elements_ += " font-weight=\"bold\"";
  if (style.upwards) elements_ += fmt::format(" transform=\"rotate(-90 {:.1f} {:.1f})\"", at.x, at.y);
  if (!style.halo.empty()) elements_ += fmt::format(" stroke=\"{}\" stroke-width=\"3\" style=\"paint-order:stroke\"", escape(style.halo));
  elements_ += fmt::format(">{}</text>\n", escape(text));
}

std::string SvgDocument::str(double width, double height) const {
  return fmt::format(
             "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
             "font-family=\"Helvetica, Arial, sans-serif\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
             width, height) +
         elements_ + "</svg>\n";
}

}  // namespace earshot
