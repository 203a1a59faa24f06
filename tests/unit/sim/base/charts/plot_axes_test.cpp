// SPDX-License-Identifier: Apache-2.0
#include "sim/base/charts/plot_axes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::vector<std::string> labels(const std::vector<PlotTick>& ticks) {
  std::vector<std::string> labels;
  for (const PlotTick& tick : ticks) labels.push_back(tick.label);
  return labels;
}

TEST(SvgDocument, EscapesTextsAndColours) {
  SvgDocument svg;
  svg.text({1, 2}, "a < b & \"c\" > d\x01\n");
  svg.line({0, 0}, {1, 1}, {.stroke = "red\"/><script>"});
  EXPECT_THAT(svg.str(10, 10), HasSubstr(">a &lt; b &amp; &quot;c&quot; &gt; d\xEF\xBF\xBD\xEF\xBF\xBD</text>"));
  EXPECT_THAT(svg.str(10, 10), HasSubstr("stroke=\"red&quot;/&gt;&lt;script&gt;\""));
}

TEST(SvgDocument, HoldsItsElementsInOrder) {
  SvgDocument svg;
  svg.polyline({}, {.stroke = "red"});
  const std::vector<SvgPoint> points{{1, 2}, {3.25, 4}};
  svg.polyline(points, {.stroke = "red", .stroke_width = 1.5, .dash = "6 4"});
  svg.circle({5, 6}, 2.4, {.fill = "blue"});
  const std::string text = svg.str(20, 30);
  EXPECT_TRUE(text.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"30\" viewBox=\"0 0 20 30\""));
  EXPECT_TRUE(
      text.ends_with("<polyline points=\"1.0,2.0 3.2,4.0\" fill=\"none\" stroke=\"red\" stroke-width=\"1.5\" stroke-dasharray=\"6 4\"/>\n"
                     "<circle cx=\"5.0\" cy=\"6.0\" r=\"2.4\" fill=\"blue\"/>\n</svg>\n"))
      << text;
}

TEST(PlotScale, PlacesValuesBetweenItsEndsAndOthersAtThem) {
  const PlotScale linear{.low = -60, .high = 20}, logarithmic{.low = 1, .high = 100, .logarithmic = true};
  EXPECT_DOUBLE_EQ(linear.fraction(-20), 0.5);
  EXPECT_DOUBLE_EQ(linear.fraction(-1e9), 0);
  EXPECT_DOUBLE_EQ(linear.fraction(1e9), 1);
  EXPECT_DOUBLE_EQ(logarithmic.fraction(10), 0.5);
  EXPECT_DOUBLE_EQ(logarithmic.fraction(0), 0);
}

TEST(PlotTicks, AreRoundNumbersWithinTheScale) {
  EXPECT_DOUBLE_EQ(tick_step(1), 0.2);
  EXPECT_DOUBLE_EQ(tick_step(60), 10);
  EXPECT_DOUBLE_EQ(tick_step(6.5), 2);
  EXPECT_THAT(labels(plot_ticks({.low = -60, .high = 5})), ElementsAre("-60", "-40", "-20", "0"));
  EXPECT_THAT(labels(plot_ticks({.low = 0, .high = 0.3}, 1e3)), ElementsAre("0", "50", "100", "150", "200", "250", "300"));
  EXPECT_THAT(labels(plot_ticks({.low = 0.5, .high = 20, .logarithmic = true})), ElementsAre("0.5", "1", "2", "5", "10", "20"));
  EXPECT_THAT(labels(plot_ticks({.low = 0.01, .high = 1e4, .logarithmic = true})),
              ElementsAre("0.01", "0.1", "1", "10", "100", "1000", "10000"));
}

TEST(PlotAxes, DrawsTicksWhereItsScalesSay) {
  const PlotAxes axes{
      .left = 100, .top = 10, .width = 200, .height = 50, .x_scale = {.low = 0, .high = 4}, .y_scale = {.low = 0, .high = 1}};
  EXPECT_DOUBLE_EQ(axes.x(1), 150);
  EXPECT_DOUBLE_EQ(axes.y(1), 10);
  EXPECT_DOUBLE_EQ(axes.y(0), 60);
  SvgDocument svg;
  axes.draw(svg, {{.value = 1, .label = "first\nsecond"}}, {{.value = 0.5, .label = "half"}});
  axes.draw_captions(svg, "title", "", "");
  const std::string text = svg.str(400, 100);
  EXPECT_THAT(text, HasSubstr("<text x=\"150.0\" y=\"76.0\" text-anchor=\"middle\" font-size=\"12\" fill=\"#1b1f24\">first</text>"));
  EXPECT_THAT(text, HasSubstr("<text x=\"150.0\" y=\"87.0\" text-anchor=\"middle\" font-size=\"12\" fill=\"#1b1f24\">second</text>"));
  EXPECT_THAT(text, HasSubstr("<text x=\"94.0\" y=\"39.0\" text-anchor=\"end\" font-size=\"12\" fill=\"#1b1f24\">half</text>"));
  EXPECT_THAT(text, HasSubstr(">title</text>"));
  EXPECT_THAT(text, Not(HasSubstr("rotate")));
}

}  // namespace
}  // namespace earshot
