// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "bench/accuracy/accuracy_figures.h"
#include "bench/accuracy/accuracy_tables.h"
#include "bench/measure/plot_svg.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

ModeResult result(const std::string& scene, const std::string& value, double per_source_ms, double per_rir_ms, double t20, double error) {
  ModeResult r{.scene = scene, .sweep = "preset", .value = value, .method = "path tracer"};
  r.per_source_ms = per_source_ms;
  r.per_rir_ms = per_rir_ms;
  r.rirs_per_s_two = 1e3;
  constexpr auto t20_kind = static_cast<std::size_t>(ErrorKind::t20);
  ErrorSummary& summary = r.errors.all[t20_kind];
  summary = {.mean = t20, .standard_error = error, .rms = 2 * t20, .rms_error = error, .p95 = t20, .count = 4};
  summary.bias = 1.6 * t20;
  summary.deviation = 1.2 * t20;
  r.errors.by_band[t20_kind] = {summary, summary};
  r.errors.sizes[t20_kind] = {1, 4, 5, 6};
  r.errors.poses = 2;
  return r;
}

/// Two scenes: 500 RIRs of one source take 1 + 500 / 500 = 2 ms and 2 + 1000 / 500 = 4 ms each.
AccuracyStudy two_scenes() {
  AccuracyStudy study;
  study.scenes = {{.name = "a", .spec = "shoebox:3x3x3", .triangles = 12, .rt60_s = 0.5, .truth_error_pct = 0.3},
                  {.name = "b", .spec = "b.yaml", .triangles = 5, .rt60_s = std::numeric_limits<double>::quiet_NaN()}};
  study.results = {result("a", "fast", 500, 1, 0.02, 0.003), result("b", "fast", 1000, 2, 0.04, 0.004)};
  return study;
}

TEST(AccuracyReport, MeansOverScenesByHand) {
  const AccuracyStudy study = two_scenes();
  EXPECT_NEAR(mean_shared_ms(study, "preset", "fast", 500), 3, 1e-12);
  AccuracyStudy one_silent = study;
  one_silent.results[1].errors.all[static_cast<std::size_t>(ErrorKind::t20)].count = 0;
  EXPECT_NEAR(mean_shared_ms(one_silent, "preset", "fast", 500, ErrorKind::t20), 2, 1e-12);
  const ModeMean mean = mean_over_scenes(study, "preset", "fast", ErrorKind::t20);
  EXPECT_NEAR(mean.mean, 3, 1e-12);                                                    // per cent
  EXPECT_NEAR(mean.standard_error, 0.25, 1e-12);                                       // sqrt(0.3^2 + 0.4^2) / 2
  EXPECT_NEAR(mean.rms, std::sqrt(40.0), 1e-9);                                        // 4 and 8
  EXPECT_NEAR(mean.rms_error, std::sqrt(1.44 + 10.24) / (2 * std::sqrt(40.0)), 1e-9);  // 4 * 0.3 and 8 * 0.4
  EXPECT_NEAR(mean.bias, 0.8 * mean.rms, 1e-9);
  EXPECT_NEAR(mean.deviation, 0.6 * mean.rms, 1e-9);
  EXPECT_NEAR(mean_over_scenes(study, "preset", "fast", ErrorKind::t20, 1).rms, mean.rms, 1e-9);
  EXPECT_EQ(mean_over_scenes(study, "preset", "fast", ErrorKind::t20, 2).scenes, 0);
  EXPECT_EQ(mean.scenes, 2);
  EXPECT_EQ(mean_over_scenes(study, "preset", "fast", ErrorKind::drr_db).scenes, 0);
}

// The paper's layout: rate, error; the mean of 2 and 4 ms is 3 ms, 333 per second.
TEST(AccuracyReport, MarkdownQuotesThePaperWithItsMachine) {
  const std::string text = accuracy_markdown(two_scenes());
  EXPECT_THAT(text, HasSubstr("| `fast` | 333 |"));
  EXPECT_THAT(text, HasSubstr("3 ± 0.25"));
  EXPECT_THAT(text, HasSubstr("7.7 ± 0.2"));
  EXPECT_THAT(text, HasSubstr("Xeon Gold 6230"));
  EXPECT_THAT(text, Not(HasSubstr("nan")));
}

// Differences of 5 %: sizes of 1, 4, 5 and 6 in each of two scenes, three of four within one, the one at the limit among them.
TEST(AccuracyReport, JustNoticeableDifferencesAreCounted) {
  const NoticeableErrors errors = noticeable_errors(two_scenes(), "fast", ErrorKind::t20);
  EXPECT_EQ(errors.count, 8u);
  EXPECT_NEAR(errors.within_pct, 75, 1e-9);
  EXPECT_NEAR(errors.p50, 0.8, 1e-9);
  EXPECT_NEAR(errors.p95, 1.2, 1e-9);
  EXPECT_TRUE(std::isnan(count_noticeable({}, 1).p50));
  EXPECT_THAT(noticeable_table(two_scenes()), HasSubstr("| `fast` | T20 | 5 % | ISO 3382-1"));
}

// Decay times in the open mean nothing, levels do; means over scenes leave it out.
TEST(AccuracyReport, TheOpenSceneHasLevelsAndNoDecayTimes) {
  AccuracyStudy study = two_scenes();
  study.results.push_back(result(kOpenScene, "fast", 1, 1, 0.6, 0.1));
  auto& errors = study.results.back().errors;
  errors.all[static_cast<std::size_t>(ErrorKind::level_db)] = {.mean = 0.123, .rms = 0.456, .p95 = 0.3, .count = 4};
  errors.sizes[static_cast<std::size_t>(ErrorKind::level_db)] = {0.5, 2};
  EXPECT_NEAR(mean_over_scenes(study, "preset", "fast", ErrorKind::t20).mean, 3, 1e-12);
  const std::string text = preset_scenes_table(study);
  EXPECT_THAT(text, HasSubstr("| open | `fast` |"));
  EXPECT_THAT(text, HasSubstr("0.456"));
  EXPECT_THAT(text, Not(HasSubstr("120")));  // rms of T20 there, in per cent
  EXPECT_THAT(noticeable_table(study), HasSubstr("| `fast`, open | level | 1 dB |"));
}

TEST(AccuracyReport, EveryLineOfTheCsvHasAsManyCells) {
  const std::string csv = accuracy_csv(two_scenes());
  std::set<std::ptrdiff_t> commas;
  std::size_t lines = 0;
  for (std::size_t begin = 0; begin < csv.size(); ++lines) {
    const std::size_t end = csv.find('\n', begin);
    commas.insert(std::count(csv.begin() + static_cast<std::ptrdiff_t>(begin), csv.begin() + static_cast<std::ptrdiff_t>(end), ','));
    begin = end + 1;
  }
  EXPECT_EQ(lines, 3u);
  EXPECT_EQ(commas.size(), 1u);
  EXPECT_THAT(csv, Not(HasSubstr("nan")));
}

TEST(AccuracyReport, FiguresAreDrawnFromWhatThereIs) {
  for (const std::string& svg : {pareto_figure(two_scenes()), scenes_figure(two_scenes()), sweeps_figure(two_scenes())}) {
    EXPECT_TRUE(svg.starts_with("<svg "));
    EXPECT_TRUE(svg.ends_with("</svg>\n"));
    EXPECT_THAT(svg, Not(HasSubstr("nan")));
    EXPECT_THAT(svg, Not(HasSubstr("inf")));
  }
  EXPECT_THAT(pareto_figure(two_scenes()), HasSubstr("high speed"));
}

TEST(AccuracyModes, AreDistinctAndValidAndLeaveTheLengthToTheScene) {
  for (const bool quick : {false, true}) {
    std::set<std::pair<std::string, std::string>> names;
    for (const AccuracyMode& mode : accuracy_modes(quick)) {
      EXPECT_TRUE(names.insert({mode.sweep, mode.value}).second) << mode.sweep << " " << mode.value;
      EXPECT_EQ(mode.config.threads, 1);
      EXPECT_NO_THROW(validate(mode.config)) << mode.sweep << " " << mode.value;
      if (mode.sweep != "RIR length") {
        EXPECT_EQ(mode.config.rir_length_s, 0.f);
      }
    }
    EXPECT_EQ(names.count({"preset", "fast"}), 1u);
  }
}

TEST(Plot, PutsAPointWhereItsAxesSay) {
  // One decade each way: a point at the geometric middle of 1 .. 10 lies in the middle of an axis from 1 to 10.
  PlotPanel panel{.title = "t", .x_label = "x", .y_label = "y"};
  panel.series.push_back({.name = "s", .colour = "#000", .points = {{1.4, 1.4}, {3.1622776, 3.1622776}, {7, 7}}});
  const std::string svg = plot_svg("title", "subtitle", {panel}, 1);
  EXPECT_THAT(svg, HasSubstr("cx=\"284.0\" cy=\"246.0\""));  // left 74 + 420 / 2, top 96 + 300 / 2
}

}  // namespace
}  // namespace earshot
