// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/clf_text.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/files/made_clf.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Wider to the sides than up and down, the same on both sides.
double oval_db(double angle, double around, double frequency_hz) {
  const double sine = std::sin(angle);
  return 0.0 - (1 + frequency_hz / 8000) * (8 * (1 - std::cos(angle)) + 3 * sine * sine * std::cos(2 * around));
}

TEST(ClfText, SymmetriesGiveTheSameBalloon) {
  for (const int step : {5, 10}) {
    MadeClf made{.level_db = oval_db, .step_deg = step};
    const ClfBalloon whole = parse_clf(made.text(), "a.tab");
    EXPECT_EQ(whole.step_deg, static_cast<std::size_t>(step));
    EXPECT_EQ(whole.frequency_hz, made.bands_hz);
    ASSERT_EQ(whole.level_db.size(), made.bands_hz.size() * whole.num_angles() * whole.num_angles());
    EXPECT_LT(whole.asymmetry, 1e-3);
    for (const char* symmetry : {"<horizontal>", "<full>"}) {
      made.symmetry = symmetry;
      made.line_end = "\r\n";
      const ClfBalloon part = parse_clf(made.text(), "a.tab");
      ASSERT_EQ(part.level_db.size(), whole.level_db.size());
      for (std::size_t i = 0; i < part.level_db.size(); ++i) ASSERT_NEAR(part.level_db[i], whole.level_db[i], 2e-3) << symmetry << ' ' << i;
    }
  }
  MadeClf round{.level_db = [](double angle, double, double) { return -6 * (1 - std::cos(angle)); }, .symmetry = "<rotational>"};
  const ClfBalloon balloon = parse_clf(round.text(), "a.tab");
  for (std::size_t arc = 0; arc < 19; ++arc) EXPECT_NEAR(balloon.level_db[arc * 19 + 9], -6, 1e-3);
}

TEST(ClfText, LeftAndRightCountByTheirMeanPower) {
  const MadeClf made{.level_db = [](double angle, double around, double) { return std::sin(angle) * (-3 + 0.5 * std::sin(around)); }};
  const ClfBalloon balloon = parse_clf(made.text(), "a.tab");
  const double expected = 10 * std::log10(0.5 * (std::pow(10, -0.25) + std::pow(10, -0.35)));
  EXPECT_NEAR(balloon.level_db[9 * 19 + 9], expected, 1e-3);
  EXPECT_GT(balloon.asymmetry, 0.02);
}

TEST(ClfText, WhatNoDescriptionFixesIsRefusedByName) {
  const auto error = [](const MadeClf& made) { return message_of<InputError>([&] { parse_clf(made.text(), "a.tab"); }); };
  const auto with = [](const std::string& line) { return MadeClf{.level_db = oval_db, .extra = line + "\n"}; };
  EXPECT_THAT(error(with("<VERSION>\t2")), HasSubstr("a.tab:6: <VERSION> 2: no public description fixes it"));
  EXPECT_THAT(error(with("<RADIATION>\t<halfsphere>")), HasSubstr("<RADIATION> <halfsphere>"));
  EXPECT_THAT(error(with("<BALLOON-SYMMETRY>\t<vertical>")), HasSubstr("<BALLOON-SYMMETRY> <vertical>"));
  EXPECT_THAT(error(with("<BALLOON-SYMMETRY>\t<polar>")), HasSubstr("<polar>"));
  EXPECT_THAT(error(with("<BALLOON-ARC-ORDER>\t<default>\t<rotate>\t90")), HasSubstr("<BALLOON-ARC-ORDER>"));
  EXPECT_THAT(error(with("<SIGN>\t<inverted>")), HasSubstr("<SIGN> <inverted>"));
  EXPECT_THAT(error(with("<PHASE-BALLOON>\t1")), HasSubstr("<PHASE-BALLOON>"));
  EXPECT_EQ(error(with("<BALLOON-ARC-ORDER>\t<reversed>")), "");
  MadeClf onesided{.level_db = [](double angle, double around, double) { return std::sin(angle) * 6 * std::sin(around); }};
  EXPECT_THAT(error(onesided), HasSubstr("left and right of band 125 Hz differ by"));
}

TEST(ClfText, WrongTextsAreRefusedWithTheirLine) {
  const std::string good = MadeClf{.level_db = oval_db, .symmetry = "<horizontal>"}.text();
  const auto error = [](const std::string& text) { return message_of<InputError>([&] { parse_clf(text, "a.tab"); }); };
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  EXPECT_EQ(error(good), "");
  EXPECT_THAT(error(""), HasSubstr("does not start with <CLF1>"));
  EXPECT_THAT(error("<CIF1>\n"), HasSubstr("a.tab:1: '<CIF1>'"));
  EXPECT_THAT(error(good.substr(0, good.find("<BAND>")) + "<CLF1END>\n"), HasSubstr("has no <BAND>"));
  EXPECT_THAT(error(with("<CLF1END>", "<CLF2END>")), HasSubstr("<CLF2END> ends a file that starts with <CLF1>"));
  EXPECT_THAT(error(std::string("<CLF1>\0\1\2", 9)), HasSubstr("binary CLF file"));
  EXPECT_THAT(error(with("<BAND>\t250", "<BAND>\t100")), HasSubstr("does not rise"));
  EXPECT_THAT(error(with("<BAND>\t250", "<BAND>\tlow")), HasSubstr("'low' is not a frequency"));
  EXPECT_THAT(error(with("<BAND>\t125\n", "<BAND>\t125\n0.0\t-1.0\n")), HasSubstr("a.tab:7: has 2 levels instead of 19"));
  EXPECT_THAT(error(with("<BAND>\t250\n", "")), HasSubstr("has more than 19 arcs"));
  EXPECT_THAT(error(good.substr(0, good.size() / 2)), HasSubstr("a.tab:"));
  EXPECT_THAT(error(with("0.0000\t", "0,0000\t")), HasSubstr("'0,0000' is not a number"));
  EXPECT_THAT(error(with("0.0000\t", "nan\t")), HasSubstr("'nan' is not a number"));
  EXPECT_THAT(error(with("0.0000\t", "1e9\t")), HasSubstr("outside [-300, 300]"));
  EXPECT_THAT(error(with("0.0000\t", "<nodata>\t")), HasSubstr("<nodata>"));
  // Exchanged rows and columns of a square band: the first column is no longer one level.
  MadeClf turned{.level_db = [](double angle, double around, double hz) { return oval_db(around, angle, hz); }, .symmetry = "<horizontal>"};
  EXPECT_THAT(error(turned.text()), HasSubstr("are rows and columns exchanged?"));
}

// The text is whole up to its end tag, with or without a line end behind it.  Half of the cuts fall into the last line of levels, where
// what is left of a number is a number.
TEST(ClfText, TextsCutShortAreRefused) {
  for (const int step : {5, 10}) {
    MadeClf made{.level_db = [](double angle, double, double) { return -30.5 * std::sin(angle / 2); }, .step_deg = step};
    made.symmetry = step == 5 ? "<full>" : "<rotational>";
    const std::string whole = made.text();
    const auto error = [](const std::string& text) { return message_of<InputError>([&] { parse_clf(text, "a.tab"); }); };
    const std::size_t end = whole.rfind("<CLF"), last_row = whole.rfind('\n', end - 2) + 1, complete = whole.find('>', end) + 1;
    EXPECT_EQ(error(whole), "");
    EXPECT_EQ(error(whole.substr(0, complete)), "");
    EXPECT_EQ(error(whole + "\t# end\n"), "");
    for (std::uint32_t i = 0; i < 400; ++i) {
      const auto drawn = static_cast<double>(RandomStream(31, Purpose::test).uniform2(i)[0]);
      const std::size_t from = i % 2 ? last_row : 0;
      const std::size_t cut = from + static_cast<std::size_t>(drawn * static_cast<double>(complete - from));
      EXPECT_THAT(error(whole.substr(0, cut)), HasSubstr("a.tab")) << step << ' ' << cut;
    }
    const std::string last_number_cut = whole.substr(0, whole.rfind('.', end));
    EXPECT_THAT(error(last_number_cut), HasSubstr(fmt::format("a.tab: ends without <CLF{}END>; it is cut short", step == 10 ? 1 : 2)));
  }
}

}  // namespace
}  // namespace earshot
