// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <glm/geometric.hpp>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/head/harmonic_rotation.h"
#include "sim/base/errors.h"
#include "tests/support/acoustics/harmonic_table.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace harmonic_table;
using namespace synthesis_cases;

RirSynthesizer ambisonic(int order, HarmonicNorm norm = HarmonicNorm::n3d, HarmonicAxes axes = HarmonicAxes::world, float length_s = 0.1f) {
  return RirSynthesizer(make_synthesis_tables(config_at(16000.f, length_s), BandLayout::octaves(16000.f),
                                              ListenerLayout::ambisonics(order, norm, axes), nullptr));
}

TEST(OracleO28, DirectSoundHasTheRatiosOfItsDirection) {
  RirSynthesizer n3d = ambisonic(3), sn3d = ambisonic(3, HarmonicNorm::sn3d);
  for (const bool in_bands : {false, true}) {
    for (const TableRow& row : kTable) {
      Arrival arrival = arrival_at(5.013, 0.2, direction_of(row.azimuth_deg, row.elevation_deg));  // not a whole sample
      if (in_bands)
        for (std::size_t b = 0; b < 7; ++b) arrival.amplitude[b] *= 1.f - 0.1f * static_cast<float>(b);
      const Rir a = rendered(n3d, response_with({arrival})), b = rendered(sn3d, response_with({arrival}));
      ASSERT_EQ(a.num_channels, 16);
      const auto w = a.channel(0);
      const double power = energy_of(w);
      double sum = 0;
      for (int c = 0; c < 16; ++c) {
        double product = 0, product_sn3d = 0;
        for (std::size_t n = 0; n < w.size(); ++n) {
          product += static_cast<double>(w[n]) * static_cast<double>(a.channel(c)[n]);
          product_sn3d += static_cast<double>(w[n]) * static_cast<double>(b.channel(c)[n]);
        }
        EXPECT_NEAR(product / power, row.values[static_cast<std::size_t>(c)], 1e-5) << row.azimuth_deg << " acn " << c;
        const double order = std::floor(std::sqrt(c));
        EXPECT_NEAR(product_sn3d / power, row.values[static_cast<std::size_t>(c)] / std::sqrt(2 * order + 1), 1e-5) << c;
        sum += energy_of(a.channel(c)) / power;
      }
      EXPECT_NEAR(sum, 16.0, 1e-4);
    }
  }
}

TEST(AmbisonicSynthesis, OmnidirectionalChannelIsTheMonoResponse) {
  EnergyResponse response = response_with({arrival_at(5.013, 0.2, {0, 0, -1}), arrival_at(7.5, 0.1, {1, 0, 0}, 1)});
  response.late = decay_of(0.5, 0.02, 7, 0.004f, 0.1, 3, {0.6f, 0, 0.8f}, 0.5f);
  RirSynthesizer mono = mono_at(16000.f, 0.1f), three = ambisonic(3), none = ambisonic(0);
  const Rir a = rendered(mono, response), b = rendered(three, response), c = rendered(none, response);
  ASSERT_EQ(c.num_channels, 1);
  for (std::size_t n = 0; n < a.samples.size(); ++n) {
    ASSERT_NEAR(b.channel(0)[n], a.samples[n], 1e-7);
    ASSERT_EQ(c.samples[n], a.samples[n]);
  }
}

EnergyResponse mixed_response() {
  EnergyResponse response =
      response_with({arrival_at(5.013, 0.2, glm::normalize(glm::vec3(0.3f, 0.2f, -0.8f))), arrival_at(7.5, 0.1, {1, 0, 0}, 1)});
  response.late = decay_of(0.5, 0.02, 7, 0.004f, 0.1, 2, {0.6f, 0, 0.8f}, 0.6f);
  return response;
}

TEST(OracleO28, EgoAxesAreWorldAxesTurned) {
  const EnergyResponse response = mixed_response();
  RirSynthesizer world = ambisonic(3), ego = ambisonic(3, HarmonicNorm::n3d, HarmonicAxes::ego);
  for (const ListenerOrientation& orientation : {ListenerOrientation(90 * kDegree), ListenerOrientation(0.4, -0.7, 1.1)}) {
    Rir fixed, turned;
    world.render(response, orientation, 1, fixed);
    ego.render(response, orientation, 1, turned);
    HarmonicRotation rotation(3);
    rotation.set(orientation);
    std::vector<std::span<float>> channels;
    for (std::size_t c = 0; c < 16; ++c)
      channels.push_back(
          std::span(fixed.samples).subspan(c * static_cast<std::size_t>(fixed.num_samples), static_cast<std::size_t>(fixed.num_samples)));
    rotation.apply(channels, static_cast<std::size_t>(fixed.num_samples));
    for (std::size_t n = 0; n < fixed.samples.size(); ++n) ASSERT_NEAR(turned.samples[n], fixed.samples[n], 2e-6);
  }
}

TEST(OracleO28, ThirtySixTurnsOfTenDegreesRenderTheStart) {  // docs/evidence/stability.md, H-58
  const EnergyResponse response = mixed_response();
  RirSynthesizer ego = ambisonic(2, HarmonicNorm::sn3d, HarmonicAxes::ego);
  const Rir start = rendered(ego, response, 0.3);
  double heading_rad = 0.3;
  for (int i = 0; i < 36; ++i) heading_rad += 10 * kDegree;
  const Rir round = rendered(ego, response, heading_rad);
  for (std::size_t n = 0; n < start.samples.size(); ++n) ASSERT_NEAR(round.samples[n], start.samples[n], 1e-6);
  // World axes do not depend on the orientation of the listener.
  RirSynthesizer world = ambisonic(2);
  EXPECT_EQ(rendered(world, response, 0.3).samples, rendered(world, response, 2.0).samples);
}

TEST(AmbisonicSynthesis, ImpossibleLayoutsAreRefused) {
  EXPECT_THROW(ambisonic(10), InputError);
  ListenerLayout broken;
  broken.kind = ListenerKind::array;
  EXPECT_THROW(make_synthesis_tables(config_at(16000.f), BandLayout::octaves(16000.f), broken, nullptr), InputError);
}

TEST(BinauralSynthesis, TiltedHeadHearsTheTurnedDirections) {
  RirSynthesizer synthesizer(binaural_tables());
  // Lying on the right ear, what was below is at the right.
  const ListenerOrientation lying(0, 0, 90 * kDegree);
  Rir tilted, upright;
  synthesizer.render(response_with({arrival_at(5.0, 1.0, {0, -1, 0})}), lying, 1, tilted);
  synthesizer.render(response_with({arrival_at(5.0, 1.0, {1, 0, 0})}), 0.0, 1, upright);
  for (std::size_t n = 0; n < tilted.samples.size(); ++n) ASSERT_NEAR(tilted.samples[n], upright.samples[n], 2e-5);
  // The late field turns too, and a heading given as a quaternion is the heading.
  EnergyResponse late = response_with();
  late.late = decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {0, -1, 0}, 0.9f);
  synthesizer.render(late, lying, 1, tilted);
  EXPECT_GT(db(energy_of(tilted.channel(1)) / energy_of(tilted.channel(0))), 4.0);
  synthesizer.render(late, 0.8, 1, upright);
  synthesizer.render(late, ListenerOrientation(ListenerOrientation(0.8).local_to_world()), 1, tilted);
  for (std::size_t n = 0; n < tilted.samples.size(); ++n) ASSERT_NEAR(tilted.samples[n], upright.samples[n], 1e-6);
}

}  // namespace
}  // namespace earshot
