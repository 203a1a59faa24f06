// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/acoustic_config.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "sim/base/errors.h"

namespace earshot {
namespace {

AcousticConfig read_from(const std::string& yaml) {
  ConfigReader reader = ConfigReader::from_text(yaml, "test.yaml");
  AcousticConfig config;
  read(reader, config);
  reader.finish();
  return config;
}

std::string message_of(const AcousticConfig& config) {
  try {
    validate(config);
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

TEST(Quality, PresetsAreValidAndOrdered) {
  for (const char* name : {"fast", "balanced", "high"}) EXPECT_NO_THROW(validate(acoustic_preset(name))) << name;
  EXPECT_LT(acoustic_preset("fast").rays, acoustic_preset("balanced").rays);
  EXPECT_LT(acoustic_preset("balanced").rays, acoustic_preset("high").rays);
  EXPECT_FALSE(acoustic_preset("high").diffuse_last_segment);
  EXPECT_THROW(acoustic_preset("fastest"), InputError);
}

TEST(Quality, ExponentsAreNoneANumberOrFromScattering) {
  EXPECT_EQ(read_from("{specular_exponent: from_scattering}").specular_exponent, -1.f);
  EXPECT_EQ(read_from("{specular_exponent: 30}").specular_exponent, 30.f);
  AcousticConfig config;
  for (const float valid : {-1.f, 0.f, 1.f, 1000.f}) {
    config.specular_exponent = valid;
    EXPECT_EQ(message_of(config), "") << valid;
  }
  for (const float invalid : {-2.f, -0.5f, 0.5f, 1001.f}) {
    config.specular_exponent = invalid;
    EXPECT_NE(message_of(config).find("specular_exponent"), std::string::npos) << invalid;
  }
}

TEST(Quality, DirectRaysAreACount) {
  EXPECT_EQ(read_from("{direct_rays: 500}").direct_rays, 500);
  EXPECT_THROW(read_from("{direct_rays: 4097}"), InputError);
  EXPECT_THROW(read_from("{direct_rays: -1}"), InputError);
}

TEST(Quality, ReadsEveryKey) {
  const AcousticConfig c = read_from(
      "{direct: off, early: on, late: off, diffraction: off, transmission: auto, air_absorption: off, early_order: 1, "
      "early_candidate_rays: 7, rays: 3, max_bounces: 5, time_bin_s: 0.002, sh_order: 2, rir_length_s: 0.75, source_radius_m: 0.1, "
      "diffuse_last_segment: false, scattering: 0.5, late_decode_s: 0.25, glide_paths: 5, diffraction_reflections: 1, bands: 4, "
      "low_octave: true, "
      "sample_rate_hz: 48000, "
      "seed: 18446744073709551615, threads: 3}");
  EXPECT_EQ(c.direct, Switch::off);
  EXPECT_EQ(c.early, Switch::on);
  EXPECT_EQ(c.late, Switch::off);
  EXPECT_EQ(c.transmission, Switch::automatic);
  EXPECT_EQ(c.air_absorption, Switch::off);
  EXPECT_EQ(c.early_order, 1);
  EXPECT_EQ(c.early_candidate_rays, 7);
  EXPECT_EQ(c.rays, 3);
  EXPECT_EQ(c.max_bounces, 5);
  EXPECT_EQ(c.time_bin_s, 0.002f);
  EXPECT_EQ(c.sh_order, 2);
  EXPECT_EQ(c.rir_length_s, 0.75f);
  EXPECT_EQ(c.source_radius_m, 0.1f);
  EXPECT_FALSE(c.diffuse_last_segment);
  EXPECT_EQ(c.scattering, 0.5f);
  EXPECT_EQ(c.late_decode_s, 0.25f);
  EXPECT_EQ(c.glide_paths, 5);
  EXPECT_EQ(c.diffraction_reflections, 1);
  EXPECT_EQ(c.bands, 4);
  EXPECT_TRUE(c.low_octave);
  EXPECT_EQ(c.sample_rate_hz, 48000.f);
  EXPECT_EQ(c.seed, 18446744073709551615u);  // H-50
  EXPECT_EQ(c.threads, 3);
}

TEST(Quality, RefusesUnknownKeysAndChoices) {
  EXPECT_THROW(read_from("{ray: 3}"), InputError);
  EXPECT_THROW(read_from("{early: maybe}"), InputError);
  EXPECT_THROW(read_from("{rays: many}"), InputError);
}

TEST(Quality, MessagesNameKeyAndValue) {
  const auto with = [](auto change) {
    AcousticConfig config;
    change(config);
    return message_of(config);
  };
  using C = AcousticConfig;
  EXPECT_NE(with([](C& c) { c.rays = -1; }).find("rays is -1; use "), std::string::npos);
  EXPECT_NE(with([](C& c) { c.late_decode_s = -0.1f; }).find("late_decode_s is -0.1; use "), std::string::npos);
  EXPECT_NE(with([](C& c) { c.glide_paths = 65; }).find("glide_paths is 65; use "), std::string::npos);
  EXPECT_NE(with([](C& c) { c.diffraction_reflections = 2; }).find("diffraction_reflections is 2; use "), std::string::npos);
  EXPECT_NE(with([](C& c) { c.bands = 4, c.low_octave = true; }).find("low_octave"), std::string::npos);
  EXPECT_EQ(with([](C& c) { c.low_octave = true; }), "");
  EXPECT_NE(with([](C& c) { c.bands = 33; }).find("bands is 33; use "), std::string::npos);
  EXPECT_NE(with([](C& c) { c.rir_length_s = NAN; }).find("rir_length_s"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.rir_length_s = -1; }).find("rir_length_s"), std::string::npos);  // H-33
  EXPECT_NE(with([](C& c) { c.time_bin_s = 0; }).find("time_bin_s"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.sample_rate_hz = 100; }).find("sample_rate_hz"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.scattering = NAN; }).find("scattering"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.scattering = 1.5f; }).find("scattering"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.early_order = 5; }).find("early_order"), std::string::npos);
  EXPECT_NE(with([](C& c) { c.sh_order = 6; }).find("sh_order"), std::string::npos);
  EXPECT_EQ(with([](C& c) { c.transmission = Switch::on; }), "");
  EXPECT_EQ(with([](C& c) { c.diffraction = c.transmission = Switch::off; }), "");
  EXPECT_EQ(with([](C& c) { c.rays = 0; }), "");  // H-48
}

}  // namespace
}  // namespace earshot
