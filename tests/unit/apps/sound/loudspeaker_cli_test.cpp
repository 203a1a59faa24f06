// SPDX-License-Identifier: Apache-2.0
// Channels for loudspeakers, through `rir` and `walk` in a free field: a source from any angle has the gains of the patterns.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

constexpr double kDegrees = std::numbers::pi / 180, kLayoutRateHz = 16000;
constexpr const char* kFreeField =
    "shoebox:200x200x200@1 --preset fast --set early=off late=off diffraction=off air_absorption=off rir_length_s=0.5";

struct ChannelCase {
  std::string name;
  double azimuth_deg, omni_weight = 0.5, right_m = 0;
  bool is_lfe = false;
};

struct LayoutCase {
  std::string name;
  std::vector<ChannelCase> channels;
  std::uint32_t mask = 0;
};

/// As docs/reference/conventions.md states them.
std::vector<LayoutCase> layout_cases() {
  const ChannelCase left{"left", 30}, right{"right", -30}, centre{"centre", 0}, lfe{"lfe", 0, 1, 0, true};
  return {{"mono", {{"mono", 0, 1}}},
          {"stereo", {{"left", 45}, {"right", -45}}},
          {"stereo:ms", {{"mid", 0}, {"side", 90, 0}}},
          {"stereo:ab", {{"left", 0, 1, -0.25}, {"right", 0, 1, 0.25}}},
          {"stereo:ortf", {{"left", 55, 0.5, -0.085}, {"right", -55, 0.5, 0.085}}},
          {"quad", {left, right, {"rear_left", 95}, {"rear_right", -95}}, 0x33},
          {"surround_5_1", {left, right, centre, lfe, {"surround_left", 110}, {"surround_right", -110}}, 0x60F},
          {"surround_7_1",
           {left, right, centre, lfe, {"rear_left", 135}, {"rear_right", -135}, {"side_left", 90}, {"side_right", -90}},
           0x63F}};
}

/// Where listeners stand about a source in the middle of the room, and how they face.
struct Places {
  std::vector<glm::dvec3> listeners;
  std::vector<double> heading_deg;
  double pitch_deg = 0, roll_deg = 0;
};

const glm::dvec3 kSource{100, 100, 100};

Places drawn_places(std::uint32_t number) {
  const RandomStream random(31, Purpose::test, number);
  const auto within = [&](std::uint32_t draw, double low, double high) {
    return low + (high - low) * static_cast<double>(random.uniform(draw));
  };
  Places places;
  for (std::uint32_t i = 0; i < 12; ++i) {
    const double height = within(4 * i, -1, 1), angle = within(4 * i + 1, 0, 360 * kDegrees), distance_m = within(4 * i + 2, 70, 80);
    const double radius = std::sqrt(1 - height * height);
    // Of three decimals, as they are typed.
    const auto typed = [](double value) { return std::round(1000 * value) / 1000; };
    places.listeners.push_back({typed(100 + distance_m * radius * std::cos(angle)), typed(100 + distance_m * height),
                                typed(100 + distance_m * radius * std::sin(angle))});
    places.heading_deg.push_back(std::round(within(4 * i + 3, -180, 180)));
  }
  places.pitch_deg = number == 0 ? 0 : std::round(within(100, -60, 60));
  places.roll_deg = number == 0 ? 0 : std::round(within(101, -90, 90));
  return places;
}

/// Of a source toward which a direction in the axes of the listener points.
glm::dvec3 local_direction(const Places& places, std::size_t i) {
  const glm::dvec3 world = glm::normalize(kSource - places.listeners[i]);
  const auto about = [](glm::dvec3 axis, double degrees) { return glm::angleAxis(degrees * kDegrees, axis); };
  return glm::conjugate(about({0, 1, 0}, places.heading_deg[i]) * about({1, 0, 0}, places.pitch_deg) * about({0, 0, -1}, places.roll_deg)) *
         world;
}

std::complex<double> spectrum_at(std::span<const float> samples, double hz) {
  std::complex<double> sum;
  for (std::size_t n = 0; n < samples.size(); ++n)
    sum += static_cast<double>(samples[n]) * std::polar(1.0, -2 * std::numbers::pi * hz / kLayoutRateHz * static_cast<double>(n));
  return sum;
}

class LoudspeakerCli : public Cli {
 protected:
  /// [channel][samples]
  [[nodiscard]] std::vector<std::vector<float>> channels_of(const std::string& name, std::size_t count) const {
    const std::vector<float> interleaved = read_wav(name);
    std::vector<std::vector<float>> channels(count);
    EXPECT_EQ(interleaved.size() % count, 0u) << name;
    for (std::size_t i = 0; i < interleaved.size(); ++i) channels[i % count].push_back(interleaved[i]);
    return channels;
  }
  /// Channels, format and mask, as RIFF files have them.
  void expect_header(const std::string& name, const LayoutCase& layout) const {
    const std::string bytes = read(name);
    std::uint32_t mask = 0;
    if (layout.mask != 0) std::memcpy(&mask, bytes.data() + 40, 4);
    EXPECT_EQ(mask, layout.mask) << layout.name;
    EXPECT_EQ(static_cast<std::uint8_t>(bytes[21]), layout.mask != 0 ? 0xFF : 0x00) << layout.name;  // WAVE_FORMAT_EXTENSIBLE
    EXPECT_EQ(bytes[22], static_cast<char>(layout.channels.size())) << layout.name;
  }
  /// Of every listener.
  [[nodiscard]] std::vector<std::vector<std::vector<float>>> responses(const std::string& channels, std::size_t count,
                                                                       const Places& places) const {
    std::string line = fmt::format("rir {} --channels {} --source {}", kFreeField, channels, point_text(kSource));
    for (const glm::dvec3& listener : places.listeners) line += " --listener " + point_text(listener);
    for (const double heading : places.heading_deg) line += fmt::format(" --heading={}", heading);
    line += fmt::format(" --pitch={} --roll={} --out {} --metrics {}", places.pitch_deg, places.roll_deg, file("r.wav"), file("r.json"));
    const CliOutcome outcome = earshot(line);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    std::vector<std::vector<std::vector<float>>> all;
    for (std::size_t i = 0; i < places.listeners.size(); ++i) all.push_back(channels_of(fmt::format("r.s0.l{}.wav", i), count));
    return all;
  }
};

TEST_F(LoudspeakerCli, ASourceFromAnyAngleHasTheGainsOfThePatterns) {
  for (std::uint32_t number = 0; number < 2; ++number) {
    const Places places = drawn_places(number);
    const auto mono = responses("mono", 1, places);
    const nlohmann::json pairs = parse_json(read("r.json")).at("pairs");
    for (const LayoutCase& layout : layout_cases()) {
      const auto heard = responses(layout.name, layout.channels.size(), places);
      for (std::size_t i = 0; i < places.listeners.size(); ++i) {
        const double distance_m = glm::length(kSource - places.listeners[i]);
        const double speed_m_per_s = distance_m / pairs.at(i).at("direct_delay_s").get<double>();
        const std::complex<double> omni = spectrum_at(mono[i][0], 500);
        EXPECT_NEAR(std::abs(omni) * 4 * std::numbers::pi * distance_m, 1, 1e-3);
        const glm::dvec3 from = local_direction(places, i);
        for (std::size_t c = 0; c < layout.channels.size(); ++c) {
          const ChannelCase& channel = layout.channels[c];
          if (channel.is_lfe) continue;
          const glm::dvec3 front(-std::sin(channel.azimuth_deg * kDegrees), 0, -std::cos(channel.azimuth_deg * kDegrees));
          const double gain = channel.omni_weight + (1 - channel.omni_weight) * glm::dot(front, from);
          // A microphone on the side of the source hears it earlier; 5e-3 is the wave's curvature and its spreading over half a metre.
          const double early_s = channel.right_m * from.x / speed_m_per_s;
          const std::complex<double> expected = gain * std::polar(1.0, 2 * std::numbers::pi * 500 * early_s);
          const std::complex<double> found = spectrum_at(heard[i][c], 500) / omni;
          EXPECT_LT(std::abs(found - expected), channel.right_m == 0 ? 1e-3 : 1e-2) << layout.name << " " << channel.name << " " << i;
        }
      }
    }
  }
}

// Fed to its loudspeakers, a layout is heard where the energy vector sum g^2 u / sum g^2 points (Gerzon 1992).
TEST_F(LoudspeakerCli, EnergyVectorsPointWhereThePatternsSay) {
  Places around;
  for (int i = 0; i < 24; ++i) {
    const double angle = 15 * i * kDegrees;  // to the left of a listener who faces -z
    around.listeners.push_back(
        {100 + std::round(1000 * 75 * std::sin(angle)) / 1000, 100, 100 + std::round(1000 * 75 * std::cos(angle)) / 1000});
    around.heading_deg.push_back(0);
  }
  // Where loudspeakers are dense the vector follows the source; behind the last pair of quad it stays with that pair.
  const std::array<std::pair<const char*, double>, 3> largest_error_deg{{{"quad", 69}, {"surround_5_1", 37}, {"surround_7_1", 16}}};
  for (const LayoutCase& layout : layout_cases()) {
    const auto bound = std::ranges::find(largest_error_deg, layout.name, [](const auto& entry) { return std::string(entry.first); });
    if (bound == largest_error_deg.end()) continue;
    const auto heard = responses(layout.name, layout.channels.size(), around);
    double worst_deg = 0;
    for (std::size_t i = 0; i < around.listeners.size(); ++i) {
      const double source_deg = 15.0 * static_cast<double>(i);
      std::complex<double> vector, expected;
      for (std::size_t c = 0; c < layout.channels.size(); ++c) {
        if (layout.channels[c].is_lfe) continue;
        double energy = 0;
        for (const float sample : heard[i][c]) energy += static_cast<double>(sample) * static_cast<double>(sample);
        const double angle = layout.channels[c].azimuth_deg * kDegrees, gain = 0.5 + 0.5 * std::cos(source_deg * kDegrees - angle);
        vector += energy * std::polar(1.0, angle);
        expected += gain * gain * std::polar(1.0, angle);
      }
      EXPECT_NEAR(std::arg(vector / expected) / kDegrees, 0, 0.2) << layout.name << " " << source_deg;
      worst_deg = std::max(worst_deg, std::abs(std::arg(vector * std::polar(1.0, -source_deg * kDegrees)) / kDegrees));
    }
    EXPECT_LT(worst_deg, bound->second) << layout.name;
    EXPECT_GT(worst_deg, 0.9 * bound->second) << layout.name;
  }
}

TEST_F(LoudspeakerCli, TheLowFrequencyChannelIsLowPassedAt120Hz) {
  const Places places = drawn_places(5);
  const auto mono = responses("mono", 1, places), surround = responses("surround_5_1", 6, places);
  for (std::size_t i = 0; i < places.listeners.size(); ++i)
    for (const double hz : {20.0, 60.0, 90.0, 120.0, 170.0, 240.0, 480.0, 1000.0}) {
      const double ratio = std::tan(std::numbers::pi * hz / kLayoutRateHz) / std::tan(std::numbers::pi * 120 / kLayoutRateHz);
      EXPECT_NEAR(std::abs(spectrum_at(surround[i][3], hz) / spectrum_at(mono[i][0], hz)), 1 / std::sqrt(1 + std::pow(ratio, 8)), 2e-3)
          << hz;
    }
}

TEST_F(LoudspeakerCli, ChannelsAreNamedInTheMetricsAndTheHeader) {
  for (const LayoutCase& layout : layout_cases()) {
    const CliOutcome outcome =
        earshot("rir shoebox:6x3x5@0.3 --preset fast --set rays=64 rir_length_s=0.2 --source 2,1.5,2 --listener 4,1.5,3 --channels " +
                layout.name + " --out " + file("n.wav") + " --metrics " + file("n.json"));
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    std::vector<std::string> names;
    for (const ChannelCase& channel : layout.channels) names.push_back(channel.name);
    const nlohmann::ordered_json json = nlohmann::ordered_json::parse(read("n.json"));
    EXPECT_EQ(json.at("channels").get<std::vector<std::string>>(), names);
    if (layout.name != "mono") {
      std::vector<std::string> measured;
      for (const auto& entry : json.at("microphones").items()) measured.push_back(entry.key());
      EXPECT_EQ(measured, names);
    }
    expect_header("n.wav", layout);
  }
}

TEST_F(LoudspeakerCli, AnUnknownLayoutIsRefusedWithTheList) {
  const std::string room = "shoebox:6x3x5@0.3 --source 2,1.5,2 --listener 4,1.5,3 --out " + file("x.wav") + " --channels ";
  for (const char* name : {"surround_9_1", "stereo:zz", "5.1", "QUAD"}) {
    expect_bad_input("rir " + room + name, "is not a known layout");
    EXPECT_THAT(read("stderr"),
                HasSubstr("mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1, ambisonic"));
    EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
  }
}

TEST_F(LoudspeakerCli, ALayoutFileGivesChannelsOfItsOwn) {
  write("front.yaml",
        "microphones:\n"
        "  - {name: wide, omni_weight: 0.7, azimuth_deg: 80}\n"
        "  - {name: up, pattern: dipole, azimuth_deg: 20, elevation_deg: 50}\n"
        "  - {name: bass, lowpass_hz: 300}\n");
  const Places places = drawn_places(9);
  const auto mono = responses("mono", 1, places), heard = responses("array:" + file("front.yaml"), 3, places);
  for (std::size_t i = 0; i < places.listeners.size(); ++i) {
    const glm::dvec3 from = local_direction(places, i);
    const auto towards = [&](double azimuth_deg, double elevation_deg) {
      const double level = std::cos(elevation_deg * kDegrees);
      return glm::dot(from, glm::dvec3(-level * std::sin(azimuth_deg * kDegrees), std::sin(elevation_deg * kDegrees),
                                       -level * std::cos(azimuth_deg * kDegrees)));
    };
    const auto gain = [&](std::size_t channel, double hz) { return spectrum_at(heard[i][channel], hz) / spectrum_at(mono[i][0], hz); };
    EXPECT_LT(std::abs(gain(0, 500) - (0.7 + 0.3 * towards(80, 0))), 1e-3);
    EXPECT_LT(std::abs(gain(1, 500) - towards(20, 50)), 1e-3);
    EXPECT_NEAR(std::abs(gain(2, 300)), std::sqrt(0.5), 2e-3);
  }
  const std::string room = "rir shoebox:6x3x5@0.3 --source 2,1.5,2 --listener 4,1.5,3 --out " + file("x.wav") + " --channels array:";
  expect_bad_input(room + write("typo.yaml", "microphones:\n  - {name: a}\n  - {name: b, azimut_deg: 3}\n"), "azimuth_deg");
  EXPECT_THAT(read("stderr"), HasSubstr("typo.yaml:3"));
  expect_bad_input(room + write("low.yaml", "microphones:\n  - {name: a, lowpass_hz: 5}\n"), "lowpass_hz");
  EXPECT_THAT(read("stderr"), HasSubstr("low.yaml:2"));
  expect_bad_input(room + write("high.yaml", "microphones:\n  - {name: a, lowpass_hz: 9000}\n"), "half of the sample rate");
  expect_bad_input(room + write("near.yaml", "microphones:\n  - {name: a, lowpass_hz: 7999.9}\n"),
                   "at most 0.45 of the sample rate, 7200 Hz");
}

// A listener at rest walks: the levels of the channels over that of one omnidirectional microphone.
TEST_F(LoudspeakerCli, AWalkHasTheGainsOfThePatterns) {
  const RandomStream random(41, Purpose::test);
  const double heading_deg = std::round(360 * static_cast<double>(random.uniform(0)));
  write("poses.csv", fmt::format("0,100,100,140,{0}\n0.6,100,100,140,{0}\n", heading_deg));
  const auto levels = [&](const LayoutCase& layout) {
    const CliOutcome outcome = earshot(fmt::format("walk {} --channels {} --poses {} --source {} --sound synth:noise --out {}", kFreeField,
                                                   layout.name, file("poses.csv"), point_text(kSource), file("w.wav")));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    expect_header("w.wav", layout);
    std::vector<double> found;
    for (const std::vector<float>& channel : channels_of("w.wav", layout.channels.size())) {
      double energy = 0;
      for (const float sample : channel) energy += static_cast<double>(sample) * static_cast<double>(sample);
      found.push_back(std::sqrt(energy));
    }
    return found;
  };
  const std::vector<LayoutCase> layouts = layout_cases();
  const double omni = levels(layouts[0])[0];
  ASSERT_GT(omni, 0);
  for (std::size_t l = 1; l < layouts.size(); ++l) {
    const std::vector<double> heard = levels(layouts[l]);
    for (std::size_t c = 0; c < heard.size(); ++c) {
      const ChannelCase& channel = layouts[l].channels[c];
      if (channel.is_lfe) continue;
      // The source is ahead of a listener who faces -z: at -heading to the left of this one.
      const double gain = channel.omni_weight + (1 - channel.omni_weight) * std::cos((heading_deg + channel.azimuth_deg) * kDegrees);
      EXPECT_NEAR(heard[c] / omni, std::abs(gain), channel.right_m == 0 ? 2e-3 : 2e-2) << layouts[l].name << " " << channel.name;
    }
  }
}

}  // namespace
}  // namespace earshot
