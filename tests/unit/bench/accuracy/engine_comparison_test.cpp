// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/engine_comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/base/errors.h"
#include "tests/support/acoustics/image_sum.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

ShoeboxRoom small_room(double absorption) {
  ShoeboxRoom room = comparison_rooms(true).front();
  for (auto& wall : room.absorption) std::fill(wall.begin(), wall.end(), absorption);
  return room;
}

// Against the sum of images that the tests have of their own, for walls of one absorption: its bins begin at emission, those of the bench
// at the direct sound, so that totals are compared, and the fraction that comes after 50 ms by C50.
TEST(ShoeboxImages, HaveTheEnergyOfTheSumOfTheTests) {
  const ShoeboxRoom room = small_room(0.2);
  const glm::dvec3 source = room.source_m, at = room.listeners_m[1];
  const RoomMetrics metrics = measure_images(room, 1);
  const double bin_s = 1e-4, direct_s = metrics.direct_delay_s.value();
  const auto series = image_sum::energy_series({room.size_m.x, room.size_m.y, room.size_m.z}, 0.2, {source.x, source.y, source.z},
                                               {at.x, at.y, at.z}, bin_s, room.length_s);
  double early = 0, late = 0, direct = 0;
  for (std::size_t i = 0; i < series.size(); ++i) {
    const double after_s = (static_cast<double>(i) + 0.5) * bin_s - direct_s;
    (after_s < 0.05 ? early : late) += series[i];
    if (after_s < 0.0025) direct += series[i];
  }
  for (const BandMetrics& band : metrics.bands) {
    EXPECT_NEAR(band.c50_db.value(), 10 * std::log10(early / late), 0.02);  // bins of 0.1 ms at the limit
    EXPECT_NEAR(band.drr_db.value(), 10 * std::log10(direct / (early + late - direct)), 1e-3);
  }
  EXPECT_NEAR(metrics.drr_db.value(), metrics.bands[0].drr_db.value(), 1e-6);
}

// A source 1 m from x0 with all other walls absorbing everything: the direct sound at 2 m and one image at 4 m.
TEST(ShoeboxImages, EachWallHasItsOwnAbsorption) {
  ShoeboxRoom room = small_room(1);
  std::fill(room.absorption[0].begin(), room.absorption[0].end(), 0.36);
  room.source_m = {1, 1.5, 2};
  room.listeners_m = {{3, 1.5, 2}};
  EXPECT_NEAR(measure_images(room, 0).bands[3].drr_db.value(), 10 * std::log10(16 / (4 * 0.64)), 1e-6);
  std::swap(room.absorption[0], room.absorption[1]);  // now x1, 5.1 m: the image lies 6.2 m away
  EXPECT_NEAR(measure_images(room, 0).bands[3].drr_db.value(), 10 * std::log10(6.2 * 6.2 / (4 * 0.64)), 1e-6);
}

// One image 0.36 of the energy of the wall taken: at 2 and 4 m pulses of 1 and 0.8 / 2 of the direct one's pressure, flat in frequency.
TEST(ShoeboxImages, RenderedImagesArePulsesOfTheirPressure) {
  ShoeboxRoom room = small_room(1);
  std::fill(room.absorption[0].begin(), room.absorption[0].end(), 0.36);
  room.source_m = {1, 1.5, 2};
  room.listeners_m = {{3, 1.5, 2}};
  room.speed_of_sound_m_per_s = 320;  // 100 and 200 samples
  const std::vector<float> response = render_images(room, 0);
  const double direct = 1 / (4 * std::numbers::pi * 2);
  EXPECT_NEAR(response.at(100), direct, 0.02 * direct);  // no energy below 40 Hz
  EXPECT_NEAR(response.at(200), 0.4 * direct, 0.02 * direct);
  EXPECT_NEAR(response.at(150), 0, 0.02 * direct);
}

TEST(MirrorBox, HasTheAbsorptionThatOthersAreTold) {
  for (const ShoeboxRoom& room : comparison_rooms(false)) {
    AcousticConfig config = acoustic_preset("fast");
    config.scattering = 0;
    const AcousticSurfaces surfaces(mirror_box(room), config);
    for (std::uint32_t wall = 0; wall < 6; ++wall)
      for (std::size_t b = 0; b < room.bands_hz.size(); ++b) {
        EXPECT_NEAR(surfaces.reflectance(wall)[b], 1 - room.absorption[wall][b], 1e-4) << wall << " " << b;
        EXPECT_EQ(surfaces.scattering(wall)[b], 0);
      }
  }
}

/// An engine written in a shell, and a folder for it.
class EngineProtocol : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("earshot_engine_test" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  EngineCommand engine(const std::string& script) const {
    const std::filesystem::path path = folder_ / "engine.sh";
    std::ofstream(path) << "set -e\nfolder=$(dirname \"$1\")\n" << script;
    return {"fake", "sh '" + path.string() + "'"};
  }
  std::string refusal(const std::string& script, double timeout_s = 60) const {
    try {
      static_cast<void>(ask_engine(engine(script), room_, 0.01, folder_, timeout_s));
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  std::filesystem::path folder_;
  ShoeboxRoom room_ = comparison_rooms(true).front();
};

/// Four WAVs of eight samples (32-bit float, 16 kHz), the first of them 1.
constexpr const char* kWriteWavs =
    "for i in 0 1 2 3; do printf 'RIFF\\104\\0\\0\\0WAVEfmt "
    "\\020\\0\\0\\0\\003\\0\\001\\0\\200\\076\\0\\0\\0\\372\\0\\0\\004\\0\\040\\0"
    "data\\040\\0\\0\\0\\0\\0\\200\\077\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0' "
    "> \"$folder/listener_$i.wav\"; done\n";
constexpr const char* kWriteResult = "echo '{\"seconds\": [0.5, 0.5, 0.5, 1.1], \"setting\": \"one sample\"}' > \"$folder/result.json\"\n";

TEST_F(EngineProtocol, AnswersAreReadAndTimesAveraged) {
  const EngineAnswer answer = ask_engine(
      engine(std::string("grep -q '\"seconds_per_response\": 0.01' \"$1\"\n") + kWriteWavs + kWriteResult), room_, 0.01, folder_);
  EXPECT_TRUE(answer.available);
  EXPECT_EQ(answer.setting, "one sample");
  EXPECT_NEAR(answer.seconds_per_response, 0.65, 1e-12);
  ASSERT_EQ(answer.responses.size(), 4u);
  ASSERT_EQ(answer.responses[3].size(), 8u);
  EXPECT_EQ(answer.responses[3][0], 1.f);
}

TEST_F(EngineProtocol, WhatIsWrongIsOneLineThatNamesTheEngine) {
  EXPECT_THAT(refusal("echo out of memory >&2; exit 3\n"), HasSubstr("failed with exit code 3: out of memory"));
  EXPECT_THAT(refusal(kWriteWavs), HasSubstr("wrote no result.json"));
  EXPECT_THAT(refusal(std::string(kWriteWavs) + kWriteResult + "rm \"$folder/listener_3.wav\"\n"), HasSubstr("wrote no listener_3.wav"));
  EXPECT_THAT(refusal(std::string(kWriteWavs) + "echo '{\"seconds\": [1]}' > \"$folder/result.json\"\n"), HasSubstr("4 listeners"));
  EXPECT_THAT(refusal(std::string(kWriteWavs) + "echo '{\"seconds\": [1,1,1,0]}' > \"$folder/result.json\"\n"), HasSubstr("positive"));
  EXPECT_THAT(refusal("sleep 30\n", 0.2), HasSubstr("took longer than 0.2 s"));
  for (const char* script : {"exit 3\n", "exit 0\n"}) {
    const std::string line = refusal(script);
    EXPECT_THAT(line, HasSubstr("engine fake"));
    EXPECT_THAT(line, Not(HasSubstr("\n")));
  }
}

// Results of a run before are not taken for those of one that wrote nothing.
TEST_F(EngineProtocol, OldFilesAreNoAnswer) {
  static_cast<void>(ask_engine(engine(std::string(kWriteWavs) + kWriteResult), room_, 0.01, folder_));
  EXPECT_THAT(refusal("true\n"), HasSubstr("wrote no result.json"));
}

TEST_F(EngineProtocol, AnAbsentPackageLeavesTheEngineOut) {
  const EngineAnswer answer = ask_engine(engine("echo 'no such package' >&2; exit 69\n"), room_, 0.01, folder_);
  EXPECT_FALSE(answer.available);
  EXPECT_EQ(answer.note, "no such package");
  EngineComparison comparison;
  comparison.rooms = {room_};
  comparison.points.push_back({.engine = "earshot, path tracer", .setting = "64 rays", .ms = 1});
  comparison.left_out = {"fake is left out: no such package"};
  EXPECT_THAT(engines_markdown(comparison), HasSubstr("fake is left out: no such package"));
}

TEST(EngineCommand, IsNameAndCommand) {
  const EngineCommand engine = EngineCommand::parse("mine=python3 engine.py --key=value");
  EXPECT_EQ(engine.name, "mine");
  EXPECT_EQ(engine.command, "python3 engine.py --key=value");
  for (const char* text : {"mine", "=command", "mine=", ""}) EXPECT_THROW(EngineCommand::parse(text), InputError) << text;
}

// T20 of 1.1 and 0.9 s against 1 s at two listeners: rms 10 %; C50 always 2 dB off.
TEST(JudgeResponses, ErrorsByHand) {
  const auto metrics = [](double t20_s, double c50_db) {
    RoomMetrics room_metrics;
    room_metrics.bands_hz = {1000};
    room_metrics.bands.resize(1);
    room_metrics.bands[0].t20_s = t20_s;
    room_metrics.bands[0].c50_db = c50_db;
    return room_metrics;
  };
  const EnginePoint point = judge_responses({{metrics(1, 0), metrics(1, 0)}}, {{metrics(1.1, 2), metrics(0.9, -2)}});
  EXPECT_NEAR(point.t20_all.rms, 0.1, 1e-12);
  ASSERT_EQ(point.t20.size(), 1u);
  EXPECT_NEAR(point.t20[0].rms, 0.1, 1e-12);
  EXPECT_NEAR(point.c50_db.rms, 2, 1e-12);
  EXPECT_TRUE(std::isnan(point.drr_db.rms));
}

TEST(CompareEngines, OursAreJudgedWhereNoOtherIsNamed) {
  const EngineComparison comparison = compare_engines({}, true);
  ASSERT_EQ(comparison.points.size(), 3u);
  EXPECT_TRUE(std::isnan(comparison.points[0].ms));  // the exact pressure, which is its own truth
  EXPECT_EQ(comparison.points[0].pressure_t20.rms, 0);
  EXPECT_GT(comparison.points[0].t20_all.rms, 0);
  EXPECT_GT(comparison.points[1].pressure_t20.rms, 0);
  for (const EnginePoint& point : comparison.points) {
    EXPECT_FALSE(point.ms <= 0);
    EXPECT_EQ(point.t20.size(), 7u);
    EXPECT_GT(point.t20_all.count, 0);
    // A box of mirrors of other walls, or a response cut short, is off by far more.
    EXPECT_LT(point.c50_db.rms, 2.5);
  }
  EXPECT_TRUE(engines_figure(comparison).starts_with("<svg "));
}

}  // namespace
}  // namespace earshot
