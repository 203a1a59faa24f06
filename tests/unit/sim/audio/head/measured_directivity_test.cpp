// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/measured_directivity.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/directions.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

constexpr double kSoundSpeed = 343.0;

/// Gain by the cosine to the front.
using AxialPattern = std::function<double(double cosine, double frequency_hz)>;

/// Points spread evenly over the sphere, in no rows, from height `lowest` to `highest` of 1.
std::vector<glm::vec3> spiral(int count, double lowest = -1, double highest = 1) {
  std::vector<glm::vec3> points;
  for (int i = 0; i < count; ++i) {
    const double y = lowest + (highest - lowest) * (i + 0.5) / count, level = std::sqrt(1 - y * y);
    const double angle = 2 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
    points.emplace_back(level * std::sin(angle), y, -level * std::cos(angle));
  }
  return points;
}

MeasuredSource source_of(const AxialPattern& pattern, const std::vector<glm::vec3>& directions, const std::vector<double>& frequency_hz) {
  MeasuredSource source{.frequency_hz = frequency_hz, .direction = directions, .pressure = {}};
  for (const glm::vec3 direction : directions)
    for (const double frequency : frequency_hz)
      source.pressure.emplace_back(std::polar(0.3 + frequency / 1e3, frequency / 70.0) *
                                   pattern(-static_cast<double>(direction.z), frequency));
  return source;
}

/// Mean of the squared gain over the sphere as the engine hears it: midpoints in height and azimuth.
double radiated(const Directivity& pattern, float frequency_hz) {
  const std::array<float, 1> centre{frequency_hz};
  const BandDirectivity bands(std::shared_ptr<const Directivity>(&pattern, [](const Directivity*) {}), centre, {});
  constexpr int rows = 180, columns = 72;
  double sum = 0;
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      const double y = (2.0 * i + 1) / rows - 1, level = std::sqrt(1 - y * y), angle = 2 * std::numbers::pi * j / columns;
      std::array<float, 1> gain{};
      bands.pressure({static_cast<float>(level * std::sin(angle)), static_cast<float>(y), static_cast<float>(-level * std::cos(angle))},
                     gain);
      sum += std::pow(static_cast<double>(gain[0]), 2);
    }
  return sum / (rows * columns);
}

double baffled(double cosine, double ka) {
  const double x = ka * std::sqrt(std::max(0.0, 1 - cosine * cosine));
  return x < 1e-6 ? 1.0 : 2 * std::cyl_bessel_j(1.0, x) / x;
}

// Power against that of an omnidirectional source of the same level on the axis: 1, 1/3, 1/3, and of a piston whose two sides radiate alike
// 2 (1 - J1(2 ka) / ka) / (ka)^2 (Kinsler and others, Fundamentals of Acoustics, 4th ed., eq. 7.6.9).  0.1 dB for 2,000 directions in no
// rows, and with the 15 degrees around each pole left out; 0.3 dB for 400.
TEST(MeasuredDirectivity, RadiatesThePowerOfTheClosedForm) {
  constexpr double ka = 4;
  const double hz = 1000;
  const std::vector<std::pair<AxialPattern, double>> patterns = {
      {[](double, double) { return 1.0; }, 1.0},
      {[](double cosine, double) { return cosine; }, 1.0 / 3},
      {[](double cosine, double) { return 0.5 * (1 + cosine); }, 1.0 / 3},
      {[](double cosine, double) { return baffled(cosine, ka); }, 2 * (1 - std::cyl_bessel_j(1.0, 2 * ka) / ka) / (ka * ka)}};
  for (std::size_t i = 0; i < patterns.size(); ++i) {
    const auto& [pattern, power] = patterns[i];
    for (const auto& [directions, tolerance_db] : {std::pair{spiral(2000), 0.1}, {spiral(2000, -0.966, 0.966), 0.1}, {spiral(400), 0.3}}) {
      const auto measured = measured_directivity(source_of(pattern, directions, {hz}), "test");
      EXPECT_NEAR(10 * std::log10(radiated(*measured, 1000.f)), 10 * std::log10(power), tolerance_db) << i << ' ' << directions.size();
      EXPECT_FLOAT_EQ(measured->pressure({0, 0, -1}, 1000.f), 1.f);
    }
  }
}

TEST(MeasuredDirectivity, HasItsDirectionsAndTheirSigns) {
  const AxialPattern dipole = [](double cosine, double) { return cosine; };
  const auto measured = measured_directivity(source_of(dipole, spiral(1500), {500, 2000}), "test");
  for (std::uint32_t i = 0; i < 200; ++i) {
    const glm::vec3 direction = random_direction(5, i);
    EXPECT_NEAR(measured->pressure(direction, 900.f), -direction.z, 0.02f);
  }
}

// The mean power of a piston in a baffle over an octave, by midpoints of its closed form.
double octave_power(double cosine, double radius_m, double low_hz, double high_hz) {
  constexpr int steps = 2000;
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double hz = low_hz + (i + 0.5) * (high_hz - low_hz) / steps;
    sum += std::pow(baffled(cosine, 2 * std::numbers::pi * hz / kSoundSpeed * radius_m), 2) / steps;
  }
  return sum;
}

// Lines every 20 Hz, a flat spectrum on the axis: 0.3 dB where an octave has -20 dB or more, of pistons whose lobes 5 degrees resolve.
TEST(MeasuredDirectivity, OctavesHaveTheMeanPowerOfTheirLines) {
  std::vector<double> lines;
  for (double hz = 60; hz <= 12000; hz += 20) lines.push_back(hz);
  std::array<float, 7> centre{};
  std::array<float, 8> edge{};
  for (std::size_t b = 0; b < edge.size(); ++b) {
    const double steps = 0.3 * (static_cast<double>(b) - 3);
    if (b < centre.size()) centre[b] = static_cast<float>(1000 * std::pow(10, steps));
    edge[b] = static_cast<float>(1000 * std::pow(10, steps - 0.15));
  }
  int compared = 0;
  for (std::uint32_t i = 0; i < 2; ++i) {
    const double radius_m = 0.02 + 0.02 * static_cast<double>(RandomStream(8, Purpose::test).uniform2(i)[0]);
    MeasuredSource source{.frequency_hz = lines, .direction = spiral(2000), .pressure = {}};
    for (const glm::vec3 direction : source.direction)
      for (const double hz : lines)
        source.pressure.emplace_back(std::polar(1.0, hz / 70.0) *
                                     baffled(-static_cast<double>(direction.z), 2 * std::numbers::pi * hz / kSoundSpeed * radius_m));
    const BandDirectivity bands(measured_directivity(source, "test"), centre, edge);
    for (std::uint32_t d = 0; d < 100; ++d) {
      const glm::vec3 direction = random_direction(9 + i, d);
      std::array<float, 7> gain{};
      bands.pressure(direction, gain);
      for (std::size_t b = 0; b < centre.size(); ++b) {
        const double power =
            octave_power(-static_cast<double>(direction.z), radius_m, static_cast<double>(edge[b]), static_cast<double>(edge[b + 1]));
        if (power < 0.01) continue;
        ++compared;
        EXPECT_NEAR(20 * std::log10(std::abs(gain[b])), 10 * std::log10(power), 0.3) << radius_m << ' ' << centre[b] << ' ' << direction.z;
      }
    }
  }
  EXPECT_GT(compared, 1000);
}

/// CLF text of these levels off the axis; 0 dB on it.
std::string levels_off_axis(const std::vector<std::pair<double, double>>& level_db) {
  std::string text = "<CLF1>\n<BALLOON-SYMMETRY>\t<rotational>\n";
  for (const auto& [hz, db] : level_db) {
    text += fmt::format("<BAND>\t{}\n0", hz);
    for (int angle = 10; angle <= 180; angle += 10) text += fmt::format("\t{}", db);
    text += '\n';
  }
  return text + "<CLF1END>\n";
}
float gain_of_band(const std::vector<std::pair<double, double>>& level_db, float low_hz, float centre_hz, float high_hz) {
  const BandDirectivity band(clf_directivity_from_text(levels_off_axis(level_db), "test.tab"), std::array{centre_hz},
                             std::array{low_hz, high_hz});
  std::array<float, 1> gain{};
  band.pressure({1, 0, 0}, gain);
  return gain[0];
}

// Third octaves as wide as they are: 0.26, 0.32 and 0.42 of the octave, of which the middle one is 20 dB down.  What a file lacks around
// its lines has those next to it, and a band with one line or none what the lines around its centre say.
TEST(MeasuredDirectivity, BandsCountTheLinesThatTheyHave) {
  const auto db = [](float gain) { return 20 * std::log10(static_cast<double>(gain)); };
  EXPECT_NEAR(db(gain_of_band({{800, 0}, {1000, -20}, {1250, 0}}, 708, 1000, 1413)), -1.7, 0.1);
  EXPECT_NEAR(db(gain_of_band({{800, -3}, {1000, -3}, {1250, -3}}, 708, 1000, 1413)), -3, 1e-4);
  EXPECT_NEAR(db(gain_of_band({{500, 0}, {1000, -20}, {2000, 0}}, 708, 1000, 1413)), -20, 1e-4);
  EXPECT_NEAR(db(gain_of_band({{250, 0}, {4000, -20}}, 708, 1000, 1413)), 20 * std::log10(0.55), 1e-3);
  // Drawn levels of exact third octaves, and of a band that ends within one.
  for (std::uint32_t i = 0; i < 20; ++i) {
    const auto drawn = [&](std::uint32_t k) { return -20 * static_cast<double>(RandomStream(10, Purpose::test).uniform2(4 * i + k)[0]); };
    std::vector<std::pair<double, double>> levels;
    for (std::uint32_t k = 0; k < 3; ++k) levels.emplace_back(1000 * std::exp2((static_cast<double>(k) - 1) / 3), drawn(k));
    const double high_hz = 1300 + 5 * drawn(3);
    const std::array<double, 4> edge{1000 * std::exp2(-0.5), 1000 * std::exp2(-1.0 / 6), 1000 * std::exp2(1.0 / 6), high_hz};
    double power = 0;
    for (std::size_t k = 0; k < 3; ++k)
      power += std::max(0.0, edge[k + 1] - edge[k]) / (high_hz - edge[0]) * std::pow(10, levels[k].second / 10);
    EXPECT_NEAR(db(gain_of_band(levels, static_cast<float>(edge[0]), 1000, static_cast<float>(high_hz))), 10 * std::log10(power), 0.01);
  }
}

// The back of a dipole is turned in a band if it is in all lines of it; if one of three has it unturned, the magnitude is left.
TEST(MeasuredDirectivity, BandsHaveTheSignOnWhichTheirLinesAgree) {
  for (const bool agree : {true, false}) {
    MeasuredSource source{.frequency_hz = {790, 1000, 1270}, .direction = spiral(800), .pressure = {}};
    for (const glm::vec3 direction : source.direction)
      for (const bool is_middle : {false, true, false})
        source.pressure.emplace_back(is_middle && !agree ? std::abs(direction.z) : -direction.z);
    const BandDirectivity band(measured_directivity(source, "test"), std::array{1000.f}, std::array{708.f, 1413.f});
    for (std::uint32_t d = 0; d < 50; ++d) {
      const glm::vec3 direction = random_direction(13, d);
      if (std::abs(direction.z) < 0.1f) continue;  // bilinear on 5 degrees across the kink of the magnitude
      std::array<float, 1> gain{};
      band.pressure(direction, gain);
      EXPECT_NEAR(gain[0], agree ? -direction.z : std::abs(direction.z), 0.02f);
    }
  }
}

// A phase that turns with the direction has no sign: the gain stays that of the magnitude.
TEST(MeasuredDirectivity, TurningPhasesLeaveTheMagnitude) {
  MeasuredSource source{.frequency_hz = {4000}, .direction = spiral(1500), .pressure = {}};
  for (const glm::vec3 direction : source.direction)
    source.pressure.emplace_back(std::polar(1.0, 2 * std::numbers::pi * 4000 / kSoundSpeed * 0.3 * static_cast<double>(direction.x)));
  const auto measured = measured_directivity(source, "test");
  for (std::uint32_t i = 0; i < 200; ++i) EXPECT_NEAR(measured->pressure(random_direction(6, i), 4000.f), 1.f, 1e-4f);
}

// Copies of a direction, as a pole at each azimuth, count once.
TEST(MeasuredDirectivity, CopiesOfADirectionCountOnce) {
  const AxialPattern cardioid = [](double cosine, double) { return 0.5 * (1 + cosine); };
  std::vector<glm::vec3> directions = spiral(600);
  const auto single = measured_directivity(source_of(cardioid, directions, {1000}), "test");
  for (int i = 0; i < 50; ++i) directions.push_back(directions[7]);
  const auto copied = measured_directivity(source_of(cardioid, directions, {1000}), "test");
  for (std::uint32_t i = 0; i < 100; ++i) {
    const glm::vec3 direction = random_direction(7, i);
    EXPECT_NEAR(copied->pressure(direction, 1000.f), single->pressure(direction, 1000.f), 1e-5f);
  }
}

TEST(MeasuredDirectivity, HolesAndSilentFrontsAreRefused) {
  const auto error = [](const AxialPattern& pattern, const std::vector<glm::vec3>& directions) {
    return message_of<InputError>([&] { measured_directivity(source_of(pattern, directions, {1000}), "speaker.sofa"); });
  };
  const AxialPattern omni = [](double, double) { return 1.0; };
  EXPECT_THAT(error(omni, spiral(300, 0.1, 1)), testing::HasSubstr("speaker.sofa: has 300 directions that leave a hole of"));
  EXPECT_THAT(error([](double cosine, double) { return 1 - cosine; }, spiral(300)), testing::HasSubstr("no level in front at 1000 Hz"));
}

TEST(MeasuredSource, GoesThroughBytesAndRefusesDamage) {
  const MeasuredSource source = source_of([](double cosine, double) { return cosine; }, spiral(50), {100, 200, 400});
  const std::string bytes = encode_source(source);
  const MeasuredSource back = decode_source(bytes, "test");
  EXPECT_EQ(back.pressure, source.pressure);
  EXPECT_EQ(back.frequency_hz, source.frequency_hz);
  for (std::size_t size = 0; size < bytes.size(); size += 7) EXPECT_THROW(decode_source(bytes.substr(0, size), "test"), InputError);
  MeasuredSource wrong = source;
  wrong.pressure.pop_back();
  EXPECT_THROW(validate(wrong, "test"), InputError);
  wrong = source;
  wrong.direction[3] *= 1.1f;
  EXPECT_THROW(validate(wrong, "test"), InputError);
}

}  // namespace
}  // namespace earshot
