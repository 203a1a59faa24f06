// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <fstream>
#include <string>

#include "sim/acoustics/core/histogram_sum.h"
#include "tests/support/acoustics/acoustic_engines.h"
#include "tests/support/acoustics/synthesis_cases.h"

/// What takes many repetitions or minutes of sound.
namespace earshot {
namespace {

using namespace engines;

TEST(H51_RepeatedQueriesSlow, AHundredThousandAtOnePose) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config;
    config.rays = 2;
    config.early_order = 1;
    config.rir_length_s = 0.1f;
    const Heard heard(engine, rooms::shoe1(0.3, 0.4), config, rooms::shoe1_source(), 512);
    EnergyResponse response;
    heard.at(rooms::shoe1_listener(), response);
    const std::vector<float> first = bits_of(response);
    for (int i = 0; i < 100'000; ++i) {
      heard.at(rooms::shoe1_listener(), response);
      if (i % 10 == 0) {
        ASSERT_TRUE(same_bits(bits_of(response), first)) << i;
      }
    }
  }
}

/// Resident memory of this process in bytes, 0 where it cannot be read.
double resident_bytes() {
  std::ifstream status("/proc/self/statm");
  double pages = 0, resident = 0;
  status >> pages >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

TEST(H34_AMinuteAt96kHzSlow, IsRenderedAndMeasuredInBoundedMemory) {
  AcousticConfig config;
  config.rir_length_s = 60;
  config.sample_rate_hz = 96000.f;
  config.rays = 64;
  config.max_bounces = 100'000;
  const double before = resident_bytes();
  const Heard heard(Engine::path_tracer, rooms::shoe1(0.01, 0.5), config, rooms::shoe1_source());
  const EnergyResponse response = heard.at(rooms::shoe1_listener());
  expect_sound(response);
  EXPECT_EQ(response.late.num_bins(), 15'000);
  RirSynthesizer synthesizer(make_synthesis_tables(heard.scene.config(), heard.scene.bands(), ChannelLayout::binaural, nullptr));
  const Rir rir = synthesis_cases::rendered(synthesizer, response);
  ASSERT_EQ(rir.num_samples, 5'760'000);
  double energy = 0;
  for (const float sample : rir.samples) {
    ASSERT_TRUE(std::isfinite(sample));
    energy += double{sample} * sample;
  }
  EXPECT_GT(energy, 0.0);
  EXPECT_LT(resident_bytes() - before, 1.5e9);
  // T = 10 s (Sabine 10.3 s); the response is six times as long.
  const RoomMetrics metrics = measure(rir, *measure(heard.scene, response).direct_delay_s);
  expect_sound(metrics);
  ASSERT_TRUE(metrics.bands[2].rt60_s);
  EXPECT_NEAR(*metrics.bands[2].rt60_s, *measure(heard.scene, response).bands[2].rt60_s, 0.1 * *metrics.bands[2].rt60_s);
}

TEST(H40_HundredMillionContributionsSlow, BlocksInFloatSummedInDouble) {
  constexpr int blocks = 400'000, per_block = 256;
  const std::array<float, 1> energy = {0.1f}, sh = {1.f};
  EnergyHistogram part(1, 1, 0, 1.f), result = part;
  HistogramSum sum(part);
  for (int block = 0; block < blocks; ++block) {
    part.clear();
    for (int i = 0; i < per_block; ++i) part.add(0.5f, energy, sh);
    sum.add(part);
  }
  sum.write(result);
  EXPECT_NEAR(result.energy(0, 0) / (static_cast<double>(0.1f) * blocks * per_block), 1.0, 1e-5);
}

// Users of the original report decay times that jump tenfold when an option is switched.  One Lambert room, whose exact decay is 0.48135 s
// (O-10), through every engine and every option that must not matter.
TEST(X_DecayTimeSlow, NoOptionMovesIt) {
  struct Option {
    const char* name;
    void (*set)(AcousticConfig&);
  };
  const Option options[] = {{"plain", [](AcousticConfig&) {}},
                            {"early off", [](AcousticConfig& c) { c.early = Switch::off; }},
                            {"fourth order", [](AcousticConfig& c) { c.early_order = 4; }},
                            {"one band", [](AcousticConfig& c) { c.bands = 1; }},
                            {"32 bands", [](AcousticConfig& c) { c.bands = 32, c.sample_rate_hz = 48000.f; }},
                            {"8 kHz", [](AcousticConfig& c) { c.sample_rate_hz = 8000.f; }},
                            {"96 kHz", [](AcousticConfig& c) { c.sample_rate_hz = 96000.f; }},
                            {"order 0", [](AcousticConfig& c) { c.sh_order = 0; }},
                            {"order 5", [](AcousticConfig& c) { c.sh_order = 5; }},
                            {"fine bins", [](AcousticConfig& c) { c.time_bin_s = 5e-4f; }},
                            {"coarse bins", [](AcousticConfig& c) { c.time_bin_s = 0.016f; }},
                            {"long", [](AcousticConfig& c) { c.rir_length_s = 3.f; }},
                            {"diffuse last segment", [](AcousticConfig& c) { c.diffuse_last_segment = true; }},
                            {"exact last segment", [](AcousticConfig& c) { c.diffuse_last_segment = false; }},
                            {"diffraction on", [](AcousticConfig& c) { c.diffraction = Switch::on; }},
                            {"transmission on", [](AcousticConfig& c) { c.transmission = Switch::on; }},
                            {"direct off", [](AcousticConfig& c) { c.direct = Switch::off; }},
                            {"two threads", [](AcousticConfig& c) { c.threads = 2; }},
                            {"small cells", [](AcousticConfig& c) { c.field_cell_m = 0.3f; }},
                            {"large cells", [](AcousticConfig& c) { c.field_cell_m = 10.f; }}};
  for (const Engine engine : kEngines) {
    for (const Option& option : options) {
      SCOPED_TRACE(name_of(engine) + ", " + option.name);
      AcousticConfig config;
      config.rays = 1024;
      config.rir_length_s = 0.7f;
      config.air_absorption = Switch::off;
      option.set(config);
      const Heard heard(engine, rooms::shoe1(0.2, 1), config, rooms::shoe1_source(), 8192);
      const EnergyResponse response = heard.at(rooms::shoe1_listener());
      expect_sound(response);
      const RoomMetrics metrics = measure(heard.scene, response);
      const BandMetrics& band = metrics.bands[metrics.bands.size() / 2];
      ASSERT_TRUE(band.t20_s) << name_of(band.decay);
      EXPECT_NEAR(*band.t20_s, 0.48135, 0.04 * 0.48135);  // 1000 rays: 1 % rms
    }
  }
}

}  // namespace
}  // namespace earshot
