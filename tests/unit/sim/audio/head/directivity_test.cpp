// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/directivity.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/directions.h"

namespace earshot {
namespace {

/// Azimuth counter-clockwise from the front.
glm::vec3 direction_of(double azimuth_deg, double elevation_deg) {
  const double azimuth = azimuth_deg * kDegree, elevation = elevation_deg * kDegree;
  return {static_cast<float>(-std::cos(elevation) * std::sin(azimuth)), static_cast<float>(std::sin(elevation)),
          static_cast<float>(-std::cos(elevation) * std::cos(azimuth))};
}

/// Mean of the squared gain over the sphere: midpoints in height and azimuth.
double energy_mean(const std::function<double(glm::vec3)>& gain) {
  constexpr int rows = 400, columns = 72;
  double sum = 0;
  for (int i = 0; i < rows; ++i) {
    const double elevation = std::asin((2.0 * i + 1.0) / rows - 1.0) / kDegree;
    for (int j = 0; j < columns; ++j) sum += std::pow(gain(direction_of(360.0 * j / columns, elevation)), 2);
  }
  return sum / (rows * columns);
}

struct Pattern {
  const char* name;
  double mean, q, di_db;
};

// docs/evidence/oracles.md, O-29; the omnidirectional one has none of all.  Means of a + (1 - a) cos are a^2 + (1 - a)^2 / 3.
const Pattern kPatterns[] = {{"omni", 1.0, 1.0, 0.0},
                             {"subcardioid", 0.52, 1.9231, 2.8400},
                             {"cardioid", 1.0 / 3, 3, 4.7712},
                             {"supercardioid", 0.2692, 3.7147, 5.6992},
                             {"hypercardioid", 0.25, 4, 6.0206},
                             {"dipole", 1.0 / 3, 3, 4.7712}};

TEST(OracleO29, EnergyMeanFactorAndIndexOfFirstOrderPatterns) {
  const std::array<float, 3> centres = {125.f, 1000.f, 8000.f};
  for (const Pattern& expected : kPatterns) {
    const auto pattern = Directivity::named(expected.name);
    const BandDirectivity bands(pattern, centres, {});
    EXPECT_EQ(bands.omnidirectional(), expected.mean == 1.0);
    for (std::size_t band = 0; band < 3; ++band) {
      const double mean = energy_mean([&](glm::vec3 direction) {
        std::array<float, 3> gain{};
        bands.pressure(direction, gain);
        EXPECT_EQ(gain[band], pattern->pressure(direction, centres[band]));
        return static_cast<double>(gain[band]);
      });
      EXPECT_NEAR(mean, expected.mean, 1e-4) << expected.name;  // midpoint error of cos^2 in 400 rows: 2e-6; the table has four digits
      EXPECT_NEAR(1.0 / mean, expected.q, 2e-4) << expected.name;
      EXPECT_NEAR(-10.0 * std::log10(mean), expected.di_db, 1e-4) << expected.name;
    }
  }
}

TEST(Directivity, FirstOrderPatternsHaveTheirZerosAndSigns) {
  EXPECT_NEAR(Directivity::named("cardioid")->pressure({0, 0, 1}, 1000.f), 0.0, 1e-7);
  EXPECT_NEAR(Directivity::named("dipole")->pressure({1, 0, 0}, 1000.f), 0.0, 1e-7);
  EXPECT_EQ(Directivity::named("dipole")->pressure({0, 0, 1}, 1000.f), -1.f);
  EXPECT_NEAR(Directivity::named("hypercardioid")->pressure({0, 0, 1}, 1000.f), -0.5, 1e-7);
  for (const Pattern& pattern : kPatterns) EXPECT_EQ(Directivity::named(pattern.name)->pressure({0, 0, -1}, 1000.f), 1.f);
  EXPECT_THROW(Directivity::named("cardoid"), InputError);
  EXPECT_THROW(Directivity::first_order(1.5f), InputError);
}

TEST(Voice, IsOmnidirectionalLowAndFrontalHigh) {
  const auto voice = Directivity::voice();
  for (const float frequency_hz : {63.f, 125.f, 500.f, 2000.f, 8000.f, 20000.f})
    EXPECT_NEAR(voice->pressure({0, 0, -1}, frequency_hz), 1.f, 1e-6f);
  EXPECT_NEAR(20 * std::log10(voice->pressure({0, 0, 1}, 63.f)), 0.0, 0.2);
  double before = -1;
  for (const float frequency_hz : {125.f, 250.f, 500.f, 1000.f, 2000.f}) {
    const double index_db =
        -10.0 * std::log10(energy_mean([&](glm::vec3 d) { return static_cast<double>(voice->pressure(d, frequency_hz)); }));
    EXPECT_GT(index_db, before) << frequency_hz;
    before = index_db;
  }
}

// Q of A-weighted speech: octave levels of a male voice (Crocker, Handbook of Acoustics, table 4.3) with A weights.
TEST(Voice, HasTheFactorOfATalker) {
  const auto voice = Directivity::voice();
  const std::array<std::array<double, 2>, 5> level_db = {
      {{250, 72.5 - 8.6}, {500, 74.0 - 3.2}, {1000, 68.0}, {2000, 62.0 + 1.2}, {4000, 57.0 + 1.0}}};
  double front = 0, mean = 0, behind = 0;
  for (const auto& [frequency_hz, level] : level_db) {
    const auto gain = [&, f = static_cast<float>(frequency_hz)](glm::vec3 d) { return static_cast<double>(voice->pressure(d, f)); };
    const double power = std::pow(10.0, level / 10.0);
    front += power;
    mean += power * energy_mean(gain);
    behind += power * std::pow(gain({0, 0, 1}), 2);
  }
  EXPECT_NEAR(front / mean, 2.5, 0.15);
  EXPECT_NEAR(10 * std::log10(front / behind), 6.1, 0.3);  // measured talkers: up to 10 dB
}

TEST(BandDirectivity, TableFollowsThePattern) {
  const auto voice = Directivity::voice();
  const std::array<float, 7> centres = {125.f, 250.f, 500.f, 1000.f, 2000.f, 4000.f, 8000.f};
  const BandDirectivity bands(voice, centres, {});
  std::array<float, 7> gain{};
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const glm::vec3 direction = random_direction(21, i);
    bands.pressure(direction, gain);
    // Bilinear on 5 degrees: h^2 / 8 times a curvature of up to (ka)^2 = 160 at 8 kHz behind the head, where the gain is small.
    for (std::size_t b = 0; b < 7; ++b) ASSERT_NEAR(gain[b], voice->pressure(direction, centres[b]), b < 5 ? 0.01 : 0.03) << b;
  }
  for (const glm::vec3 pole : {glm::vec3(0, 1, 0), glm::vec3(0, -1, 0), glm::vec3(0, 0, 1), glm::vec3(0, 0, -1)}) {
    bands.pressure(pole, gain);
    for (std::size_t b = 0; b < 7; ++b) EXPECT_NEAR(gain[b], voice->pressure(pole, centres[b]), 1e-5);
  }
}

/// 45 degrees, two frequencies; gain 6 dB in front at 100 Hz, falls with the angle; at 10 kHz one loud cell at the left.
const std::string kBalloon = R"({
  "name": "test", "source": "made up",
  "frequencies_hz": [100, 10000],
  "elevations_deg": [-45, 0, 45],
  "azimuths_deg": [0, 90, 180, 270],
  "gains_db": [[[3, 0, -3, 0], [6, 3, 0, 3], [3, 0, -3, 0]],
               [[0, 0, 0, 0], [0, 20, 0, 0], [0, 0, 0, 0]]]
})";

double db_at(const Directivity& pattern, glm::vec3 direction, float frequency_hz) {
  return 20.0 * std::log10(static_cast<double>(pattern.pressure(direction, frequency_hz)));
}

TEST(Balloon, HasItsNodesRelativeToTheFront) {
  const auto balloon = Directivity::balloon_from_text(kBalloon, "balloon");
  EXPECT_NEAR(db_at(*balloon, direction_of(0, 0), 100.f), 0.0, 1e-5);
  EXPECT_NEAR(db_at(*balloon, direction_of(90, 0), 100.f), -3.0, 1e-5);
  EXPECT_NEAR(db_at(*balloon, direction_of(180, 0), 100.f), -6.0, 1e-5);
  EXPECT_NEAR(db_at(*balloon, direction_of(180, 45), 100.f), -9.0, 1e-5);
  EXPECT_NEAR(db_at(*balloon, direction_of(90, 0), 10000.f), 20.0, 1e-5);  // counter-clockwise from above: at the left
  EXPECT_NEAR(db_at(*balloon, {-1, 0, 0}, 10000.f), 20.0, 1e-5);
  EXPECT_NEAR(db_at(*balloon, {1, 0, 0}, 10000.f), 0.0, 1e-5);
  // Between nodes: linear in dB over angle and log frequency; beyond the ends: held.
  EXPECT_NEAR(db_at(*balloon, direction_of(45, 0), 100.f), -1.5, 1e-4);
  EXPECT_NEAR(db_at(*balloon, direction_of(315, 0), 100.f), -1.5, 1e-4);
  EXPECT_NEAR(db_at(*balloon, direction_of(90, 0), 1000.f), 8.5, 1e-4);
  EXPECT_NEAR(db_at(*balloon, direction_of(90, 0), 50.f), -3.0, 1e-5);
  // The pole has the mean power of the last row: gains -3, -6, -9, -6 dB.
  EXPECT_NEAR(db_at(*balloon, {0, 1, 0}, 100.f), 10 * std::log10((0.50119 + 2 * 0.25119 + 0.12589) / 4), 1e-3);
}

TEST(Balloon, IsContinuousRoundTheSeamAndOverThePoles) {
  const auto balloon = Directivity::balloon_from_text(kBalloon, "balloon");
  const std::array<float, 2> centres = {100.f, 10000.f};
  const BandDirectivity bands(balloon, centres, {});
  std::array<float, 2> before{}, now{};
  for (const bool over_pole : {false, true}) {
    const auto at = [&](double t) {
      return over_pole ? direction_of(t < 180 ? 20.0 : 200.0, t < 180 ? t - 90 : 270 - t) : direction_of(t, 10.0);
    };
    bands.pressure(at(0.0), before);
    for (double t = 0.05; t <= 360.0; t += 0.05) {
      bands.pressure(at(t), now);
      // 20 dB per 90 degrees at gain 10: 0.26 per degree, steeper between the poles and the rows at 45; a jump would be of order 1.
      for (std::size_t b = 0; b < 2; ++b) ASSERT_NEAR(now[b], before[b], 0.05) << t;
      before = now;
    }
  }
  // The grid of 5 degrees holds the nodes of the file.
  bands.pressure(direction_of(90, 0), now);
  EXPECT_NEAR(now[1], 10.0, 1e-3);
}

void expect_refused(const std::string& text, const std::string& part) {
  try {
    Directivity::balloon_from_text(text, "balloon.json");
    ADD_FAILURE() << "accepted " << text;
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("balloon.json"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
  }
}

TEST(Balloon, BadFilesAreRefused) {
  const auto with = [](const std::string& from, const std::string& to) {
    std::string text = kBalloon;
    return text.replace(text.find(from), from.size(), to);
  };
  expect_refused(with("\"frequencies_hz\"", "\"frequencies\""), "frequencies");
  expect_refused(with("[100, 10000]", "[100, 100]"), "frequencies_hz");
  expect_refused(with("[100, 10000]", "[100, 1000, 10000]"), "gains_db");
  expect_refused(with("[-45, 0, 45]", "[-45, 0, 95]"), "elevations_deg");
  expect_refused(with("[0, 90, 180, 270]", "[0, 90, 180, 360]"), "azimuths_deg");
  expect_refused(with("[6, 3, 0, 3]", "[6, 3, 0]"), "gains_db");
  expect_refused(with("[6, 3, 0, 3]", "[6, 3, .nan, 3]"), "gains_db");
  expect_refused(with("[6, 3, 0, 3]", "[6, 3, loud, 3]"), "gains_db");
  expect_refused("[1, 2", "balloon");
  EXPECT_THROW(Directivity::named("/nowhere/balloon.json"), InputError);
}

TEST(Balloon, OneElevationIsEnough) {
  // One row holds for the whole sphere, also where it is a pole itself.
  for (const char* elevation : {"90", "-90", "0"}) {
    const auto pattern = Directivity::balloon_from_text(
        std::string("{frequencies_hz: [1000], azimuths_deg: [0, 90], elevations_deg: [") + elevation + "], gains_db: [[[0, 0]]]}", "test");
    for (const glm::vec3 direction : {glm::vec3(0, 0, -1), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0), glm::vec3(1, 0, 0)})
      EXPECT_NEAR(pattern->pressure(direction, 1000.f), 1.f, 1e-6f) << elevation;
  }
}

}  // namespace
}  // namespace earshot
