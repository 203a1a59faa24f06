// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

RirSynthesizer array_of(std::vector<Microphone> microphones, float length_s = 0.1f) {
  return RirSynthesizer(make_synthesis_tables(config_at(16000.f, length_s), BandLayout::octaves(16000.f),
                                              ListenerLayout::array(std::move(microphones)), nullptr));
}

Microphone at(glm::vec3 position_m, const char* pattern = "omni", const ListenerOrientation& orientation = 0.0) {
  return {.position_m = position_m, .directivity = Directivity::named(pattern), .orientation = glm::quat(orientation.local_to_world())};
}

TEST(ArraySynthesis, EachMicrophoneHasItsOwnDistanceToTheImage) {
  const glm::vec3 direction = glm::normalize(glm::vec3(0.8f, 0.1f, -0.6f));
  const double distance_m = 2.0;
  const std::vector<glm::vec3> positions = {{0, 0, 0}, {0.5f, 0, 0}, {-0.5f, 0.2f, 0.1f}};
  std::vector<Microphone> microphones;
  for (const glm::vec3 position : positions) microphones.push_back(at(position));
  RirSynthesizer synthesizer = array_of(microphones);
  for (const double heading_rad : {0.0, 1.1}) {
    const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 0.25, direction)}), heading_rad);
    ASSERT_EQ(rir.num_channels, 3);
    for (std::size_t i = 0; i < 3; ++i) {
      // Positions turn with the listener: right is (cos, 0, -sin), up y, back (sin, 0, cos).
      const double c = std::cos(heading_rad), s = std::sin(heading_rad);
      const glm::dvec3 p = positions[i], world(c * p.x + s * p.z, p.y, -s * p.x + c * p.z);
      const double own_m = glm::length(distance_m * glm::dvec3(direction) - world);
      EXPECT_NEAR(phase_delay(rir.channel(static_cast<int>(i)), 0.05, 0.8), own_m / 343.0 * 16000.0, 0.01) << i;
      EXPECT_NEAR(std::abs(spectrum_of(rir.channel(static_cast<int>(i)))[100]), 0.25 * distance_m / own_m,
                  3e-4)
          << i;  // the tails of a delayed impulse are cut after 16 ms
    }
  }
}

TEST(ArraySynthesis, PatternsWeighArrivals) {
  RirSynthesizer synthesizer = array_of(
      {at({0, 0, 0}), at({0, 0, 0}, "cardioid"), at({0, 0, 0}, "dipole"), at({0, 0, 0}, "cardioid", ListenerOrientation(-90 * kDegree))});
  const auto gains = [&](glm::vec3 direction, double heading_rad) {
    const Rir rir = rendered(synthesizer, response_with({arrival_at(3.43, 0.25, direction)}), heading_rad);  // sample 160
    std::array<double, 4> result{};
    for (std::size_t i = 0; i < 4; ++i) result[i] = static_cast<double>(rir.channel(static_cast<int>(i))[160]) / 0.25;
    return result;
  };
  const auto expect = [](const std::array<double, 4>& a, const std::array<double, 4>& b) {
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(a[i], b[i], 1e-5) << i;
  };
  expect(gains({0, 0, -1}, 0.0), {1, 1, 1, 0.5});
  expect(gains({0, 0, 1}, 0.0), {1, 0, -1, 0.5});
  expect(gains({1, 0, 0}, 0.0), {1, 0.5, 0, 1});
  expect(gains({1, 0, 0}, -90 * kDegree), {1, 1, 1, 0.5});  // turned right: now in front
}

// A source's own polarity and a microphone's cancel.
TEST(ArraySynthesis, PhasesOfArrivalsAreKept) {
  RirSynthesizer synthesizer = array_of({at({0, 0, 0}), at({0, 0, 0}, "dipole")});
  Arrival arrival = arrival_at(3.43, 0.25, {0, 0, 1});
  arrival.phase_rad.fill(std::numbers::pi_v<float>);
  const Rir rir = rendered(synthesizer, response_with({arrival}));
  EXPECT_NEAR(rir.channel(0)[160], -0.25f, 1e-6f);
  EXPECT_NEAR(rir.channel(1)[160], 0.25f, 1e-6f);
  arrival.phase_rad.fill(0.5f * std::numbers::pi_v<float>);
  const auto spectrum = spectrum_of(rendered(synthesizer, response_with({arrival})).channel(0));
  for (const std::size_t k : {200u, 700u}) {
    const double phase = std::arg(std::complex<double>(spectrum[k])) +
                         std::numbers::pi * 160.0 * static_cast<double>(k) / static_cast<double>(spectrum.size() - 1);
    EXPECT_NEAR(std::remainder(phase, 2.0 * std::numbers::pi), 0.5 * std::numbers::pi, 0.01);  // so are those of a turned one
  }
}

/// Real coherence and powers of two channels of diffuse late sound, per octave-wide sixth around each frequency.
struct Pair {
  std::array<double, 6> coherence{};
  double first = 0, second = 0;
};
Pair late_pair(RirSynthesizer& synthesizer, const EnergyHistogram& late, const ListenerOrientation& orientation, int keys) {
  const std::array<double, 6> frequency_hz = {125, 250, 500, 1000, 2000, 4000};
  std::array<std::complex<double>, 6> cross{};
  std::array<double, 6> first{}, second{};
  EnergyResponse response = response_with();
  response.late = late;
  Pair pair;
  for (int key = 0; key < keys; ++key) {
    Rir rir;
    synthesizer.render(response, orientation, static_cast<std::uint64_t>(key), rir);
    pair.first += energy_of(rir.channel(0)) / keys;
    pair.second += energy_of(rir.channel(1)) / keys;
    const auto a = spectrum_of(rir.channel(0)), b = spectrum_of(rir.channel(1));
    const double bin_hz = 8000.0 / static_cast<double>(a.size() - 1);
    for (std::size_t f = 0; f < 6; ++f) {
      for (auto k = static_cast<std::size_t>(frequency_hz[f] * 0.97 / bin_hz); static_cast<double>(k) * bin_hz < frequency_hz[f] * 1.03;
           ++k) {
        cross[f] += std::complex<double>(a[k]) * std::conj(std::complex<double>(b[k]));
        first[f] += std::norm(a[k]);
        second[f] += std::norm(b[k]);
      }
    }
  }
  for (std::size_t f = 0; f < 6; ++f) pair.coherence[f] = cross[f].real() / std::sqrt(first[f] * second[f]);
  return pair;
}

TEST(OracleO26, TwoMicrophonesInADiffuseFieldHaveTheCoherenceOfTheirDistance) {
  RirSynthesizer synthesizer = array_of({at({-0.0875f, 0, 0}), at({0.0875f, 0, 0})}, 0.5f);
  const EnergyHistogram late = decay_of(2.0, 0.02, 7);
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 2.0));
  const std::array<double, 6> expected = {0.9735, 0.8963, 0.6236, -0.0200, 0.0199, 0.0198};
  const Pair pair = late_pair(synthesizer, late, ListenerOrientation(0.4, 0.3, 0.0), 16);
  // Chance leaves 1 / sqrt(2 * 7.5 Hz * 0.5 s * 16) = 0.09 at 125 Hz, times what is not coherent there (0.05), and 0.03 and less above 1
  // kHz.
  for (std::size_t f = 0; f < 6; ++f) EXPECT_NEAR(pair.coherence[f], expected[f], 0.1) << f;
  EXPECT_NEAR(db(pair.first / put_in), 0.0, 0.3);
  EXPECT_NEAR(db(pair.second / put_in), 0.0, 0.3);
}

TEST(ArraySynthesis, LateFieldHasThePowerThatThePatternTakesIn) {
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 2.0));
  RirSynthesizer synthesizer = array_of({at({0, 0, 0}, "cardioid"), at({0, 0, 0}, "hypercardioid")}, 0.5f);
  const Pair diffuse = late_pair(synthesizer, decay_of(2.0, 0.02, 7), 0.7, 8);
  EXPECT_NEAR(db(diffuse.first / put_in), -4.7712, 0.3);  // docs/evidence/oracles.md, O-29
  EXPECT_NEAR(db(diffuse.second / put_in), -6.0206, 0.3);
  // Energy from the right: cardioids with their front there get most of it, those with their back there little.
  RirSynthesizer sides = array_of(
      {at({0, 0, 0}, "cardioid", ListenerOrientation(-90 * kDegree)), at({0, 0, 0}, "cardioid", ListenerOrientation(90 * kDegree))}, 0.5f);
  const EnergyHistogram from_right = decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.9f);
  const Pair facing = late_pair(sides, from_right, 0.0, 4), away = late_pair(sides, from_right, 180 * kDegree, 4);
  EXPECT_NEAR(db(facing.first / put_in), 0.0, 0.8);  // k = 9: mean of ((1 + cos) / 2)^2 is -0.5 dB
  EXPECT_LT(db(facing.second / put_in), -15.0);
  EXPECT_LT(db(away.first / put_in), -15.0);
}

TEST(ArraySynthesis, MonoWithAPatternIsAnArrayOfOne) {
  RirSynthesizer synthesizer(
      make_synthesis_tables(config_at(16000.f, 0.1f), BandLayout::octaves(16000.f), ListenerLayout::named("mono:cardioid"), nullptr));
  EXPECT_NEAR(rendered(synthesizer, response_with({arrival_at(3.43, 0.25, {1, 0, 0})})).samples[160], 0.125f, 1e-6f);
  const auto same = rendered(synthesizer, response_with({arrival_at(3.43, 0.25, {1, 0, 0})}));
  EXPECT_EQ(same.samples, rendered(synthesizer, response_with({arrival_at(3.43, 0.25, {1, 0, 0})})).samples);
}

}  // namespace
}  // namespace earshot
