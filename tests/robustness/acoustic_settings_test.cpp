// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "sim/acoustics/model/effect_plan.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "tests/support/acoustics/acoustic_engines.h"
#include "tests/support/acoustics/effect_scenes.h"
#include "tests/support/acoustics/synthesis_cases.h"

/// Counts, rates and lengths at the ends of their ranges.
namespace earshot {
namespace {

using namespace engines;

TEST(H29_AnyNumberOfBands, EveryEngineHearsTheSameRoom) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = plain(256);
    config.sample_rate_hz = 48000.f;
    const double one = late_energy(Heard(engine, rooms::shoe1(0.2, 0.5), config, rooms::shoe1_source(), 512).at(rooms::shoe1_listener()));
    for (int bands = 2; bands <= kMaxBands; bands += bands < 9 ? 1 : 4) {
      config.bands = bands;
      const Heard heard(engine, rooms::shoe1(0.2, 0.5), config, rooms::shoe1_source(), 512);
      ASSERT_EQ(heard.scene.num_bands(), bands);
      const EnergyResponse response = heard.at(rooms::shoe1_listener());
      expect_sound(response);
      // Flat walls: the same paths in every band.  bfloat16 of the field rounds all bands alike.
      for (int band = 0; band < bands; ++band) ASSERT_NEAR(late_energy(response, band) / one, 1.0, 2e-5) << bands;
    }
  }
}

TEST(H29_AnyNumberOfBands, RendersTheSameEnergyAtEveryRate) {
  // Also where a band is a sliver below half the rate: 32 bands at 8, 11.025 and 22.05 kHz.
  for (const float rate_hz : {8000.f, 11025.f, 16000.f, 22050.f, 44100.f, 96000.f}) {
    for (const int bands : {1, 2, 3, 9, 31, 32}) {
      EnergyResponse response = synthesis_cases::response_with({synthesis_cases::arrival_at(4.2, 0.1)});
      const int num_bands = BandLayout::log_spaced(bands, rate_hz).size();
      response.late = synthesis_cases::decay_of(0.1, 1e-2, num_bands, 0.004f, 0.12);
      RirSynthesizer synthesizer = synthesis_cases::mono_at(rate_hz, 0.12f, bands);
      // The noise under the direct sound scatters the energy by 0.4 to 0.6 dB from key to key, the mean of sixteen by 0.15; all bands have
      // one noise, so their number adds nothing.
      constexpr std::uint64_t keys = 16;
      double energy = 0;
      for (std::uint64_t key = 0; key < keys; ++key) {
        Rir rir;
        synthesizer.render(response, 0.0, key, rir);
        for (const float sample : rir.samples) ASSERT_TRUE(std::isfinite(sample)) << rate_hz << " " << bands;
        energy += synthesis_cases::energy_of(rir.samples) / keys;
      }
      EXPECT_NEAR(db(energy / (0.01 + 0.01 * (1 - std::pow(10, -7.2)))), 0.0, 0.5) << rate_hz << " " << bands;
    }
  }
}

TEST(H30_ImpossibleNumberOfBands, IsRefused) {
  for (const int bands : {-1, 33, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    AcousticConfig config;
    config.bands = bands;
    EXPECT_THROW(AcousticScene(rooms::shoe1(0.2, 0.5), config), InputError) << bands;
  }
  EXPECT_THROW(BandLayout::log_spaced(0, 16000.f), InputError);
}

TEST(H31_AllSampleRates, DelayAmplitudeAndDecayAreTheSame) {
  double first_t20 = 0;
  for (const float rate_hz : {8000.f, 11025.f, 16000.f, 22050.f, 44100.f, 48000.f, 96000.f}) {
    AcousticConfig config = plain(512);
    config.bands = 0;
    config.sample_rate_hz = rate_hz;
    config.rir_length_s = 0.6f;
    const Heard heard(Engine::path_tracer, rooms::shoe1(0.2, 1), config, rooms::shoe1_source());
    const EnergyResponse response = heard.at(rooms::shoe1_listener());
    expect_sound(response);
    ASSERT_EQ(response.arrivals.size(), 1u);
    EXPECT_NEAR(response.arrivals[0].distance_m, 2.765863, 1e-6);
    EXPECT_NEAR(response.arrivals[0].amplitude[0], 0.0287713, 1e-6);
    // Exact Lambert decay of SHOE-1 (O-10).  All bands have the same walls: their decay does not depend on the number of bands.
    const RoomMetrics metrics = measure(heard.scene, response);
    ASSERT_TRUE(metrics.bands[0].t20_s) << rate_hz;
    EXPECT_NEAR(*metrics.bands[0].t20_s, 0.48135, 0.05 * 0.48135) << rate_hz;
    if (first_t20 == 0) first_t20 = *metrics.bands[0].t20_s;
    EXPECT_NEAR(*metrics.bands[0].t20_s / first_t20, 1.0, 1e-4) << rate_hz;
    EXPECT_LE(heard.scene.bands().edge_hz.back(), 0.5f * rate_hz);
  }
}

TEST(H32_ShorterThanTheDirectDelay, IsSilentAndSucceeds) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    for (const float length_s : {0.004f, 0.0001f, 0.007f}) {  // the direct sound comes after 8.06 ms
      AcousticConfig config;
      config.rays = 64;
      config.rir_length_s = length_s;
      const Heard heard(engine, rooms::shoe1(0.2, 0.5), config, rooms::shoe1_source(), 512);
      const EnergyResponse response = heard.at(rooms::shoe1_listener());
      expect_sound(response);
      EXPECT_TRUE(response.arrivals.empty());
      for (const float value : response.late.values()) ASSERT_EQ(value, 0.f);
      const RoomMetrics metrics = measure(heard.scene, response);
      EXPECT_FALSE(metrics.direct_delay_s || metrics.drr_db);
      for (const BandMetrics& band : metrics.bands) EXPECT_EQ(band.decay, DecayStatus::silent);
      RirSynthesizer synthesizer(make_synthesis_tables(heard.scene.config(), heard.scene.bands(), ChannelLayout::mono, nullptr));
      const Rir rir = synthesis_cases::rendered(synthesizer, response);
      EXPECT_EQ(rir.num_samples, static_cast<int>(std::lround(length_s * 16000.0)));
      for (const float sample : rir.samples) ASSERT_EQ(sample, 0.f);
    }
  }
}

TEST(H33_OneSampleAndNone, OneWorksAndNoneIsRefused) {
  for (const ChannelLayout channels : {ChannelLayout::mono, ChannelLayout::binaural}) {
    AcousticConfig config;
    config.rays = 16;
    config.rir_length_s = 1.f / 16000.f;
    const Heard heard(Engine::path_tracer, rooms::shoe1(0.2, 0.5), config, rooms::shoe1_source());
    const EnergyResponse response = heard.at(rooms::shoe1_source());  // 1 cm: half a sample
    expect_sound(response);
    ASSERT_EQ(response.arrivals.size(), 1u);
    RirSynthesizer synthesizer(make_synthesis_tables(heard.scene.config(), heard.scene.bands(), channels, nullptr));
    const Rir rir = synthesis_cases::rendered(synthesizer, response);
    ASSERT_EQ(rir.num_samples, 1);
    for (const float sample : rir.samples) EXPECT_TRUE(std::isfinite(sample) && sample != 0.f);
    expect_sound(measure(rir, 0.0));
  }
  AcousticConfig automatic_length;
  automatic_length.rir_length_s = 0;  // in a config: as long as the decay needs
  EXPECT_GE(AcousticScene(rooms::shoe1(0.2, 0.5), automatic_length).config().rir_length_s, 0.1f);
  EXPECT_THROW((void)make_synthesis_tables(automatic_length, BandLayout::octaves(16000.f), ChannelLayout::mono, nullptr), InputError);
  for (const float bad : {-1.f, std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 60.001f}) {
    automatic_length.rir_length_s = bad;
    EXPECT_THROW(AcousticScene(rooms::shoe1(0.2, 0.5), automatic_length), InputError) << bad;
  }
}

TEST(H34_AMinuteAt96kHz, TooManyBinsAreRefused) {
  AcousticConfig config;
  config.rir_length_s = 60;
  config.sample_rate_hz = 96000.f;
  config.time_bin_s = 1e-5f;  // 6 million bins
  EXPECT_THROW(AcousticScene(rooms::shoe1(0.2, 0.5), config), InputError);
  config.time_bin_s = 1e-4f;
  EXPECT_NO_THROW(validate(config));
}

TEST(H48_NumberOfRays, NoneLeavesDirectSoundAndReflections) {
  for (const Engine engine : {Engine::path_tracer, Engine::bidirectional}) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config;
    config.rays = 0;
    const Heard heard(engine, rooms::shoe1(0.2, 0), config, rooms::shoe1_source());
    const EnergyResponse response = heard.at(rooms::shoe1_listener());
    expect_sound(response);
    EXPECT_EQ(engines::count(response, ArrivalKind::direct), 1u);
    EXPECT_EQ(engines::count(response, ArrivalKind::reflection), 24u);  // O-2: 25 images of order <= 2
    EXPECT_EQ(late_energy(response), 0.0);
    EXPECT_EQ(response.stats.rays, 0u);
    expect_sound(measure(heard.scene, response));
  }
}

TEST(H48_NumberOfRays, OneIsFiniteAndUnbiased) {
  for (const Engine engine : {Engine::path_tracer, Engine::bidirectional}) {
    SCOPED_TRACE(name_of(engine));
    const Heard heard(engine, rooms::shoe1(0.2, 1), plain(1), rooms::shoe1_source());
    double sum = 0;
    constexpr int kRuns = 3000;
    EnergyResponse response;
    for (int run = 0; run < kRuns; ++run) {
      compute_energy_response(heard.scene.with_rays(1, static_cast<std::uint64_t>(run)), heard.candidates, rooms::shoe1_listener(),
                              response);
      ASSERT_TRUE(engines::is_finite(response));
      sum += late_energy(response);
    }
    EXPECT_NEAR(sum / kRuns, 0.012029, 0.05 * 0.012029);  // O-10; spread over runs 0.7: four sigma
  }
}

TEST(H48_NumberOfRays, TwoToThe31IsRefusedAndOneLessIsPlanned) {
  AcousticConfig config;
  for (const char* text : {"rays: 2147483648", "rays: 99999999999999999999", "rays: -1", "rays: 1e30", "rays: nan"}) {
    EXPECT_THROW(
        {
          ConfigReader reader = ConfigReader::from_text(text, "test");
          read(reader, config);
          reader.finish();
          validate(config);
        },
        InputError)
        << text;
  }
  // Counts that an int cannot add: the plan must still see many rays.
  config = AcousticConfig{};
  config.rays = std::numeric_limits<int>::max();
  config.source_rays = 1 << 17;
  const auto scene = effects::two_rooms(9, 4, 3, 0.9, effects::material(0.15, 0.4), effects::material(0.15, 0.4, 0.05));
  const AcousticScene many_scene(scene, config);
  AcousticConfig some_config = config;
  some_config.rays = 1 << 20;
  EXPECT_EQ(many_scene.plan().traced_transmission, AcousticScene(scene, some_config).plan().traced_transmission);
  for (const EffectDecision& decision : many_scene.plan().decisions) EXPECT_GE(decision.saved_ms, 0.0) << decision.effect;
}

TEST(H48_NumberOfRays, ManyAreTracedInBlocksWithoutLosingEnergy) {
  // Free rays only: 2^20 of them, in 4096 blocks.
  AcousticConfig config = plain(1 << 20);
  config.late = Switch::on;
  config.max_bounces = 1;
  std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
  walls[4] = Material::uniform("diffuse", 0.f, 1.f);
  const Heard heard(Engine::path_tracer, rooms::box(5, 4, 3, walls), config, rooms::shoe1_source());
  const EnergyResponse response = heard.at(rooms::shoe1_listener());
  EXPECT_EQ(response.stats.ray_hits, 1u << 20);
  EXPECT_NEAR(late_energy(response), 5.257685e-04, 1e-3 * 5.257685e-04);  // O-8: 5e-3 over 32,768, a fifth of that with 32 times as many
}

}  // namespace
}  // namespace earshot
