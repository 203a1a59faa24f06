// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/transforms/low_pass.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

constexpr float kRate = 16000.f;

RirSynthesizer synthesizer_of(const ListenerLayout& layout, float length_s = 0.5f) {
  return RirSynthesizer(make_synthesis_tables(config_at(kRate, length_s), BandLayout::octaves(kRate), layout, nullptr));
}

/// A direction and an orientation that depend on the number alone.
glm::vec3 drawn_direction(std::uint32_t number) {
  const RandomStream random(17, Purpose::episode, number, 0, 0);
  const float height = 2.f * random.uniform(0) - 1.f, angle = 2.f * std::numbers::pi_v<float> * random.uniform(1);
  const float radius = std::sqrt(1.f - height * height);
  return {radius * std::cos(angle), height, radius * std::sin(angle)};
}
ListenerOrientation drawn_orientation(std::uint32_t number) {
  const RandomStream random(18, Purpose::episode, number, 0, 0);
  const auto angle = [&](std::uint32_t draw, double range) { return range * (2.0 * static_cast<double>(random.uniform(draw)) - 1.0); };
  if (number % 3 == 0) return {angle(0, std::numbers::pi)};  // level
  return {angle(0, std::numbers::pi), angle(1, 1.2), angle(2, 1.5)};
}

/// a + (1 - a) cos of the angle between a direction and the front of a microphone, in doubles.
double expected_gain(const Microphone& microphone, const ListenerOrientation& orientation, glm::dvec3 direction) {
  const glm::dvec3 front = orientation.local_to_world() * (glm::dquat(microphone.orientation) * glm::dvec3(0, 0, -1));
  const double a = static_cast<double>(microphone.omni_weight().value());
  return a + (1 - a) * glm::dot(glm::normalize(front), direction);
}

// From 68.6 m, a plane wave to what stands in one place.  A microphone aside has its own distance and direction.
TEST(LoudspeakerSynthesis, APlaneWaveFromAnyAngleHasTheGainsOfThePatterns) {
  for (const char* name : {"stereo", "stereo:ms", "stereo:ab", "stereo:ortf", "quad", "surround_5_1", "surround_7_1"}) {
    const ListenerLayout layout = ListenerLayout::named(name);
    RirSynthesizer synthesizer = synthesizer_of(layout, 0.3f);
    for (std::uint32_t number = 0; number < 24; ++number) {
      const glm::vec3 direction = drawn_direction(number);
      const ListenerOrientation orientation = drawn_orientation(number);
      const double distance_m = 68.6;
      Rir rir;
      synthesizer.render(response_with({arrival_at(distance_m, 0.25, direction)}), orientation, 1, rir);
      ASSERT_EQ(rir.num_channels, layout.num_channels());
      for (std::size_t c = 0; c < layout.microphones.size(); ++c) {
        const Microphone& microphone = layout.microphones[c];
        if (microphone.lowpass_hz > 0) continue;
        const glm::dvec3 place = orientation.local_to_world() * glm::dvec3(microphone.position_m);
        const glm::dvec3 to_source = distance_m * glm::dvec3(direction) - place;
        const double own_m = glm::length(to_source), delay = own_m / 343.0 * 16000.0;
        std::complex<double> sum;  // at 1 kHz
        const auto samples = rir.channel(static_cast<int>(c));
        for (std::size_t n = 0; n < samples.size(); ++n)
          sum +=
              static_cast<double>(samples[n]) * std::polar(1.0, 2 * std::numbers::pi * 1000.0 / 16000.0 * (static_cast<double>(n) - delay));
        const double gain = expected_gain(microphone, orientation, to_source / own_m) * distance_m / own_m;
        EXPECT_LT(std::abs(sum / 0.25 - gain), 1e-3) << name << " " << c << " " << number;
      }
    }
  }
}

TEST(LoudspeakerSynthesis, TheLowFrequencyChannelIsTheOmnidirectionalOneThroughItsLowPass) {
  RirSynthesizer surround = synthesizer_of(ListenerLayout::named("surround_5_1")), mono = synthesizer_of(ListenerLayout::named("mono"));
  const LowPass low_pass(120, 16000);
  for (std::uint32_t number = 0; number < 8; ++number) {
    const EnergyResponse response = response_with({arrival_at(3.43 + 0.37 * number, 0.25, drawn_direction(number))});
    const Rir heard = rendered(surround, response, 0.3 * number), omni = rendered(mono, response);
    std::vector<float> expected = omni.samples;
    low_pass.filter(expected);
    const auto lfe = heard.channel(3);
    for (std::size_t n = 0; n < expected.size(); ++n) ASSERT_NEAR(lfe[n], expected[n], 5e-6f) << n;  // tails are cut after 16 and 32 ms
  }
}

// Of microphones in one place in a diffuse field: powers a^2 + (1 - a)^2 / 3, covariances a b + (1 - a) (1 - b) cos / 3.  From one side: as
// first-order harmonics tell it.
TEST(LoudspeakerSynthesis, LateSoundHasThePowersAndCovariancesOfThePatterns) {
  const ListenerLayout layout = ListenerLayout::named("surround_7_1");
  RirSynthesizer synthesizer = synthesizer_of(layout);
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 2.0));
  for (const float directivity : {0.f, 0.6f}) {
    const glm::vec3 from = glm::normalize(glm::vec3(0.5f, 0.2f, -0.8f));
    EnergyResponse response = response_with();
    response.late = decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, from, directivity);
    const ListenerOrientation orientation(0.9, 0.4, -0.3);
    constexpr std::uint64_t keys = 24;
    std::array<std::array<double, 8>, 8> sum{};
    for (std::uint64_t key = 0; key < keys; ++key) {
      Rir rir;
      synthesizer.render(response, orientation, key, rir);
      for (int i = 0; i < 8; ++i)
        for (int j = 0; j <= i; ++j) {
          const auto a = rir.channel(i), b = rir.channel(j);
          for (std::size_t n = 0; n < a.size(); ++n)
            sum[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] += static_cast<double>(a[n]) * static_cast<double>(b[n]);
        }
    }
    for (std::size_t i = 0; i < 8; ++i)
      for (std::size_t j = 0; j <= i; ++j) {
        if (i == 3 || j == 3) continue;
        const auto front = [&](std::size_t c) {
          return glm::dvec3(orientation.local_to_world() * (glm::dquat(layout.microphones[c].orientation) * glm::dvec3(0, 0, -1)));
        };
        const double u = static_cast<double>(directivity), x = u * glm::dot(front(i), glm::dvec3(from)),
                     y = u * glm::dot(front(j), glm::dvec3(from));
        const double expected = 0.25 * ((1 + x) * (1 + y) + (1 - u * u) * glm::dot(front(i), front(j)) / 3);
        EXPECT_NEAR(sum[i][j] / keys / put_in, expected, 0.03) << i << " " << j << " " << directivity;
      }
  }
}

TEST(LoudspeakerSynthesis, ATurnWithTheLateSoundKeptHasTheSameBits) {
  RirSynthesizer synthesizer = synthesizer_of(ListenerLayout::named("quad"));
  EnergyResponse response = response_with({arrival_at(3.5, 0.1, {0.6f, 0, -0.8f})});
  response.late = decay_of(0.5, 0.02, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.5f);
  LateSound kept;
  for (const double heading_rad : {0.0, 0.7, -2.0}) {
    Rir cached, plain;
    synthesizer.render(response, heading_rad, 5, cached, &kept);
    synthesizer.render(response, heading_rad, 5, plain);
    EXPECT_EQ(cached.samples, plain.samples) << heading_rad;
    EXPECT_EQ(cached.channel_mask, 0x33u);
  }
}

TEST(LoudspeakerSynthesis, AnOmnidirectionalMicrophoneInPlaceHasTheDecayOfMono) {
  RirSynthesizer array = synthesizer_of(ListenerLayout::array({Microphone{}, Microphone{}})), mono = synthesizer_of(ChannelLayout::mono);
  EnergyResponse response = response_with();
  response.late = decay_of(0.4, 0.02, 7);
  const Rir heard = rendered(array, response), omni = rendered(mono, response);
  EXPECT_NEAR(db(energy_of(heard.channel(0)) / energy_of(omni.channel(0))), 0, 0.2);
  EXPECT_NEAR(t20_s(heard.channel(0), 16000) / t20_s(omni.channel(0), 16000), 1, 0.03);
  EXPECT_TRUE(std::ranges::equal(heard.channel(0), heard.channel(1)));
}

}  // namespace
}  // namespace earshot
