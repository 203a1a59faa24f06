// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "sim/acoustics/response/temporal_reuse.h"
#include "tests/support/acoustics/acoustic_engines.h"
#include "tests/support/acoustics/synthesis_cases.h"

/// The same bits for the same query: repeated, interleaved with others, moved by a micrometre, scaled.
namespace earshot {
namespace {

using namespace engines;

AcousticConfig everything(int rays = 300) {
  AcousticConfig config;  // octaves, air, image paths, first-order harmonics
  config.rays = rays;
  return config;
}

TEST(H37_LoudAndQuietSources, ResponsesScaleBitForBit) {
  // Amplitudes of 2^-30 to 2^48, 1e-9 to 3e14: energies, and their slopes from sample to sample, stay normal floats.  No absolute
  // threshold on the way; at 2^-40 the energy of samples
  // 140 dB below the direct sound is denormal and flushed: what is lost lies 160 dB below 1.  The level of a
  // source is a factor on its dry sound, not part of a response: one of 1e-20 or 1e20 has the same response.
  EnergyResponse response = synthesis_cases::response_with({synthesis_cases::arrival_at(3.1, 0.1, {0.6f, 0, -0.8f})});
  response.late = synthesis_cases::decay_of(0.3, 0.02, 7);
  RirSynthesizer synthesizer(synthesis_cases::binaural_tables());
  const Rir reference = synthesis_cases::rendered(synthesizer, response);
  for (const int exponent : {-40, -30, -20, -1, 1, 20, 48}) {
    EnergyResponse scaled = response;
    for (float& value : scaled.arrivals[0].amplitude) value = std::ldexp(value, exponent);
    for (float& value : scaled.late.values()) value = std::ldexp(value, 2 * exponent);
    const Rir rir = synthesis_cases::rendered(synthesizer, scaled);
    for (std::size_t n = 0; n < rir.samples.size(); ++n) {
      const float expected = std::ldexp(reference.samples[n], exponent);
      if (exponent >= -30) {
        ASSERT_EQ(rir.samples[n], expected) << exponent;
      } else {
        ASSERT_NEAR(rir.samples[n], expected, std::ldexp(1e-8f, exponent));
      }
    }
  }
}

TEST(H37_LoudAndQuietSources, SmallAndLargeRoomsScaleBitForBit) {
  // Energies go as 1 / k^2: a threshold would show.  Away from the origin, where the offset from surfaces is relative.
  const auto at_scale = [](Engine engine, float k) {
    TriangleMesh mesh;
    const glm::vec3 low(1), high(6, 4, 5);
    const auto at = [&](int x, int y, int z) { return k * glm::vec3(x ? high.x : low.x, y ? high.y : low.y, z ? high.z : low.z); };
    for (int side = 0; side < 2; ++side) {
      rooms::append_quad(mesh, {at(side, 0, 0), at(side, 1, 0), at(side, 1, 1), at(side, 0, 1)}, 0);
      rooms::append_quad(mesh, {at(0, side, 0), at(1, side, 0), at(1, side, 1), at(0, side, 1)}, 0);
      rooms::append_quad(mesh, {at(0, 0, side), at(1, 0, side), at(1, 1, side), at(0, 1, side)}, 0);
    }
    AcousticConfig config = rooms::plain_config();
    config.rays = 200;
    config.early = Switch::automatic;
    config.time_bin_s = 0.004f * k;
    config.rir_length_s = 0.4f * k;
    config.source_radius_m = 0.25f * k;
    config.field_cell_m = 0.5f * k;
    const Heard heard(engine, rooms::scene_of(mesh, {Material::uniform("wall", 0.2f, 0.4f)}), config, k * glm::vec3(2.2f, 2.1f, 2.5f), 512);
    return heard.at(k * glm::vec3(4.8f, 2.6f, 3.3f));
  };
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    const EnergyResponse base = at_scale(engine, 1);
    ASSERT_GT(engines::late_energy(base), 0.0);
    for (const float k : {0.25f, 16.f}) {
      const EnergyResponse scaled = at_scale(engine, k);
      ASSERT_EQ(scaled.arrivals.size(), base.arrivals.size());
      for (std::size_t i = 0; i < base.arrivals.size(); ++i) ASSERT_EQ(scaled.arrivals[i].amplitude[0], base.arrivals[i].amplitude[0] / k);
      for (int bin = 0; bin < base.late.num_bins(); ++bin)
        ASSERT_EQ(scaled.late.energy(bin, 0), base.late.energy(bin, 0) / (k * k)) << k << " bin " << bin;
    }
  }
}

TEST(H47_SourceMovesByAMicrometre, EverythingIsBuiltAnewAndHardlyChanges) {
  const glm::vec3 source = rooms::shoe1_source(), moved = source + glm::vec3(1e-6f, 0, 0);
  ASSERT_NE(source.x, moved.x);
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    const Heard before(engine, rooms::shoe1(0.2, 0.4), everything(), source, 512),
        after(engine, rooms::shoe1(0.2, 0.4), everything(), moved, 512);
    EXPECT_NE(source_field_key(before.scene, before.candidates), source_field_key(after.scene, after.candidates));
    const EnergyResponse a = before.at(rooms::shoe1_listener()), b = after.at(rooms::shoe1_listener());
    expect_sound(b);
    ASSERT_EQ(a.arrivals.size(), b.arrivals.size());
    for (std::size_t i = 0; i < a.arrivals.size(); ++i) {
      EXPECT_NEAR(a.arrivals[i].distance_m, b.arrivals[i].distance_m, 2e-6f);
      EXPECT_NEAR(a.arrivals[i].amplitude[0] / b.arrivals[i].amplitude[0], 1.f, 2e-6f);
    }
  }
}

TEST(H47_SourceMovesByAMicrometre, AlongATrajectoryThePastIsKept) {
  // Documented tolerance of the blend (temporal_reuse.h): steps up to half a metre keep the past, so a micrometre does, and averaging goes
  // on.
  const AcousticScene scene(rooms::shoe1(0.2, 1), everything(64));
  TemporalReuse reuse;
  EnergyResponse response;
  double shift = 0;
  for (int step = 0; step < 12; ++step, shift += 1e-6) {
    const EarlyCandidates candidates(scene, rooms::shoe1_source() + glm::vec3(static_cast<float>(shift), 0, 0));
    reuse.compute(scene, candidates, rooms::shoe1_listener(), response);
    expect_sound(response);
    if (step > 0) {
      EXPECT_LT(reuse.weight(), 1.0) << step;
    }
  }
}

TEST(H50_Seeds, ZeroAndTheLargestAndInterleavedInstances) {
  constexpr std::uint64_t largest = std::numeric_limits<std::uint64_t>::max();
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    const auto with_seed = [&](std::uint64_t seed) {
      AcousticConfig config = everything();
      config.seed = seed;
      return std::make_unique<Heard>(engine, rooms::shoe1(0.2, 0.3), config, rooms::shoe1_source(), 512);
    };
    const auto ask = [](const Heard& heard, int step) {
      return bits_of(heard.at(rooms::shoe1_listener() + glm::vec3(0.1f * static_cast<float>(step), 0, 0)));
    };
    // Alone, one after the other.
    std::vector<std::vector<float>> alone;
    for (const std::uint64_t seed : {std::uint64_t{0}, largest}) {
      const auto heard = with_seed(seed);
      for (int step = 0; step < 4; ++step) alone.push_back(ask(*heard, step));
      for (const float value : alone.back()) ASSERT_TRUE(std::isfinite(value));
    }
    EXPECT_FALSE(same_bits(alone[0], alone[4]));
    // Two at a time, in turns.
    const auto zero = with_seed(0), other = with_seed(largest);
    for (std::size_t step = 0; step < 4; ++step) {
      EXPECT_TRUE(same_bits(ask(*zero, static_cast<int>(step)), alone[step])) << step;
      EXPECT_TRUE(same_bits(ask(*other, static_cast<int>(step)), alone[4 + step])) << step;
    }
  }
}

TEST(H51_RepeatedQueries, TenThousandAtOnePoseAndOthersBetween) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = everything(2);
    config.early_order = 1;
    config.rir_length_s = 0.1f;
    const Heard heard(engine, rooms::shoe1(0.3, 0.4), config, rooms::shoe1_source(), 512);
    EnergyResponse response;
    heard.at(rooms::shoe1_listener(), response);
    const std::vector<float> first = bits_of(response);
    for (int i = 0; i < 5000; ++i) {
      heard.at(rooms::point(1 + 0.0005 * i, 1, 1), response);
      heard.at(rooms::shoe1_listener(), response);
      if (i % 50 == 0) {
        ASSERT_TRUE(same_bits(bits_of(response), first)) << i;
      }
    }
    EXPECT_TRUE(same_bits(bits_of(response), first));
  }
}

}  // namespace
}  // namespace earshot
