// SPDX-License-Identifier: Apache-2.0
// What a measurement refuses, and the reasons of parameters that a response does not have.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/draw_spread.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr float kMissingRateHz = 32000.f;

double missing_draw(std::uint32_t stream, std::uint32_t draw, double low, double high) {
  return low + (high - low) * static_cast<double>(RandomStream(49, Purpose::test, 1, stream).uniform(draw));
}

ParameterRequest all_groups() {
  ParameterRequest request;
  request.lateral = request.stage = request.speech = true;
  return request;
}

std::string reason_of(const RoomMetrics& metrics, const std::string& key) {
  for (const MissingParameter& missing : metrics.missing)
    if (missing.key == key) return missing.reason;
  return "";
}

bool has(const RoomMetrics& metrics, std::optional<double> BandMetrics::*value) { return (metrics.bands.at(4).*value).has_value(); }

/// Noise that decays from time zero on, energy exp(-13.8 t / T).
std::vector<float> decaying_noise(std::uint32_t stream, double t60_s, double length_s) {
  const RandomStream random(49, Purpose::test, 2, stream);
  std::vector<float> samples(static_cast<std::size_t>(std::lround(length_s * static_cast<double>(kMissingRateHz))));
  for (std::size_t n = 0; n < samples.size(); ++n)
    samples[n] =
        random.normal2(static_cast<std::uint32_t>(n))[0] *
        static_cast<float>(std::exp(-3 * std::numbers::ln10 * static_cast<double>(n) / static_cast<double>(kMissingRateHz) / t60_s));
  return samples;
}

std::string refusal_of(std::span<const float> rir, const RirMeasurement& how) {
  try {
    (void)measure(rir, kMissingRateHz, how);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(MeasurementCheck, DirectSoundLiesWithinTheResponse) {
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const auto size = static_cast<std::size_t>(missing_draw(1, 2 * draw, 1, 9000));
    const std::vector<float> rir(size, 0.1f);
    const double length_s = static_cast<double>(size) / static_cast<double>(kMissingRateHz);
    const double after_s = length_s * missing_draw(1, 2 * draw + 1, 1, 3), before_s = length_s * missing_draw(1, 2 * draw + 1, 0, 0.999);
    const std::string refused = refusal_of(rir, {.direct_delay_s = after_s});
    EXPECT_THAT(refused, testing::HasSubstr("direct_delay_s")) << size;
    EXPECT_THAT(refused, testing::HasSubstr("ends after")) << size;
    EXPECT_EQ(refusal_of(rir, {.direct_delay_s = before_s}), "") << size;
  }
  const std::vector<float> rir(32000, 0.1f);
  EXPECT_THAT(refusal_of(rir, {.direct_delay_s = 100}), testing::AllOf(testing::HasSubstr("100 s"), testing::HasSubstr("1 s")));
  EXPECT_NE(refusal_of(rir, {.direct_delay_s = std::numeric_limits<double>::quiet_NaN()}), "");
  EXPECT_NE(refusal_of(rir, {.distance_m = 0}), "");
}

TEST(MeasurementCheck, RefusesWhatDoesNotGoTogether) {
  ParameterRequest lateral;
  lateral.lateral = true;
  const std::vector<float> rir = decaying_noise(0, 0.3, 0.5), other = decaying_noise(1, 0.3, 0.5), silent(rir.size(), 0.f);
  EXPECT_THAT(refusal_of(rir, {.lateral = other}), testing::HasSubstr("without lateral parameters"));
  EXPECT_THAT(refusal_of(rir, {.request = lateral, .lateral = rir}), testing::HasSubstr("the measured response itself"));
  EXPECT_THAT(refusal_of(rir, {.reference_10m = other, .is_green = true}), testing::HasSubstr("green_units"));
  EXPECT_EQ(refusal_of(rir, {.request = lateral, .lateral = other, .reference_10m = other}), "");
  EXPECT_EQ(refusal_of(silent, {.request = lateral, .lateral = silent}), "");
}

TEST(MissingParameters, StrengthNeedsAReference) {
  for (std::uint32_t draw = 0; draw < 6; ++draw) {
    const double t60_s = missing_draw(2, draw, 0.2, 0.6);
    const std::vector<float> rir = decaying_noise(draw, t60_s, 1.0), reference(100, 0.1f);
    const RoomMetrics uncalibrated = measure(rir, kMissingRateHz, {.direct_delay_s = 0});
    EXPECT_THAT(reason_of(uncalibrated, "g_db"), testing::HasSubstr("reference"));
    for (const BandMetrics& band : uncalibrated.bands) EXPECT_FALSE(band.g_db);
    for (const RirMeasurement& how :
         {RirMeasurement{.direct_delay_s = 0, .reference_10m = reference}, RirMeasurement{.direct_delay_s = 0, .is_green = true}}) {
      const RoomMetrics calibrated = measure(rir, kMissingRateHz, how);
      EXPECT_EQ(reason_of(calibrated, "g_db"), "");
      for (const BandMetrics& band : calibrated.bands) EXPECT_TRUE(band.g_db);
    }
  }
}

TEST(MissingParameters, StageNeedsALineOfSightInSamplesToo) {
  for (std::uint32_t draw = 0; draw < 6; ++draw) {
    const std::vector<float> rir = decaying_noise(draw, missing_draw(3, draw, 0.3, 0.6), 1.3);
    const double delay_s = missing_draw(3, 20 + draw, 0, 0.2);
    RirMeasurement how{.direct_delay_s = delay_s, .request = all_groups(), .is_green = true};
    const RoomMetrics seen = measure(rir, kMissingRateHz, how);
    EXPECT_TRUE(has(seen, &BandMetrics::st_early_db) && has(seen, &BandMetrics::st_late_db));
    how.has_direct = false;
    const RoomMetrics hidden = measure(rir, kMissingRateHz, how);
    for (const char* key : {"st_early_db", "st_late_db"}) EXPECT_THAT(reason_of(hidden, key), testing::HasSubstr("line of sight"));
    for (const BandMetrics& band : hidden.bands) EXPECT_FALSE(band.st_early_db || band.st_late_db);
  }
}

// Each parameter exists from the length on that its definition names.
TEST(MissingParameters, OfShortResponses) {
  struct Needed {
    const char* key;
    std::optional<double> BandMetrics::*value;
    double length_s;
  };
  const std::vector<Needed> needed{{"j_lf", &BandMetrics::j_lf, 0.08},
                                   {"j_lfc", &BandMetrics::j_lfc, 0.08},
                                   {"st_early_db", &BandMetrics::st_early_db, 0.1},
                                   {"st_late_db", &BandMetrics::st_late_db, 1.0}};
  for (std::uint32_t draw = 0; draw < 24; ++draw) {
    const double length_s = draw % 2 == 0 ? missing_draw(4, draw, 0.03, 0.13) : missing_draw(4, draw, 0.2, 1.2);
    const double delay_s = missing_draw(4, 100 + draw, 0, 0.3);
    std::vector<float> rir = decaying_noise(2 * draw, 0.5, length_s), lateral = decaying_noise(2 * draw + 1, 0.5, length_s);
    const auto before = static_cast<std::size_t>(std::lround(delay_s * static_cast<double>(kMissingRateHz)));
    rir.insert(rir.begin(), before, 0.f), lateral.insert(lateral.begin(), before, 0.f);
    const RoomMetrics metrics = measure(
        rir, kMissingRateHz, {.direct_delay_s = delay_s, .request = all_groups(), .lateral = lateral, .is_green = true, .distance_m = 1});
    for (const Needed& one : needed) {
      EXPECT_EQ(has(metrics, one.value), length_s >= one.length_s) << one.key << " " << length_s;
      EXPECT_EQ(reason_of(metrics, one.key).empty(), length_s >= one.length_s) << one.key << " " << length_s;
    }
  }
}

// Speech and late lateral parameters need the decay: a response cut after 8 dB has none, one that is kept for 60 dB has all.
TEST(MissingParameters, OfDecaysThatAreCut) {
  for (std::uint32_t draw = 0; draw < 8; ++draw) {
    const double t60_s = missing_draw(5, draw, 1, 2.5);
    for (const bool is_whole : {true, false}) {
      const double length_s = is_whole ? t60_s : 8.0 / 60.0 * t60_s;
      const std::vector<float> rir = decaying_noise(2 * draw, t60_s, length_s), lateral = decaying_noise(2 * draw + 1, t60_s, length_s);
      const RoomMetrics metrics =
          measure(rir, kMissingRateHz, {.direct_delay_s = 0, .request = all_groups(), .lateral = lateral, .is_green = true});
      EXPECT_EQ(has(metrics, &BandMetrics::mti), is_whole) << t60_s;
      EXPECT_EQ(metrics.sti.has_value(), is_whole) << t60_s << " " << reason_of(metrics, "sti");
      EXPECT_EQ(has(metrics, &BandMetrics::lg_db), is_whole) << t60_s << " " << reason_of(metrics, "lg_db");
      for (const char* key : {"mti", "sti", "lg_db"}) EXPECT_EQ(reason_of(metrics, key).empty(), is_whole) << key << " " << t60_s;
    }
  }
}

// The same of energy responses: a late field that ends before it has decayed.
TEST(MissingParameters, OfEnergyResponsesThatAreCut) {
  for (std::uint32_t draw = 0; draw < 6; ++draw) {
    const double t60_s = missing_draw(6, draw, 1, 2.5), k = 6 * std::numbers::ln10 / t60_s, start_s = 0.01;
    for (const bool is_whole : {true, false}) {
      AcousticConfig config;
      config.air_absorption = Switch::off;
      config.sh_order = 4;
      config.rir_length_s = static_cast<float>(start_s + (is_whole ? 1.0 : 8.0 / 60.0) * t60_s);
      const AcousticScene scene(rooms::shoe1(0.2, 1), config);
      EnergyResponse response;
      response.late = make_histogram(scene);
      std::vector<float> sh(25, 0.f);
      sh[0] = 1.f;
      for (double t = 5e-4; t < static_cast<double>(config.rir_length_s) - start_s; t += 1e-3)
        response.late.add(static_cast<float>(start_s + t),
                          std::vector<float>(static_cast<std::size_t>(scene.num_bands()), static_cast<float>(std::exp(-k * t))), sh);
      Arrival& first = response.arrivals.emplace_back();
      first.distance_m = static_cast<float>(start_s * scene.speed_of_sound_m_per_s());
      first.amplitude.fill(1e-3f);
      ParameterRequest request = all_groups();
      request.lateral_axis = glm::vec3(1, 0, 0);
      const RoomMetrics metrics = measure(scene, response, request);
      EXPECT_EQ(metrics.sti.has_value(), is_whole) << t60_s;
      for (const char* key : {"mti", "sti", "lg_db"}) EXPECT_EQ(reason_of(metrics, key).empty(), is_whole) << key << " " << t60_s;
    }
  }
}

TEST(MissingParameters, SilenceIsTheReasonOfAll) {
  const AcousticScene scene(rooms::shoe1(0.2, 1), AcousticConfig{});
  EnergyResponse nothing;
  nothing.late = make_histogram(scene);
  const std::vector<float> silent(4000, 0.f);
  for (int groups = 0; groups < 8; ++groups) {
    ParameterRequest request;
    request.lateral = (groups & 1) != 0, request.stage = (groups & 2) != 0, request.speech = (groups & 4) != 0;
    for (const RoomMetrics& metrics : {measure(scene, nothing, request), measure(silent, kMissingRateHz, {.request = request})}) {
      std::size_t asked = request.speech ? 1 : 0;
      if (request.speech) {
        EXPECT_EQ(reason_of(metrics, "sti"), "the response is silent");
      }
      for (const RequestedMetricKey& entry : kRequestedMetricKeys) {
        if (!(request.*entry.group)) continue;
        ++asked;
        EXPECT_EQ(reason_of(metrics, entry.key), "the response is silent") << entry.key;
      }
      EXPECT_EQ(metrics.missing.size(), asked);
      EXPECT_FALSE(metrics.bands.empty());
    }
  }
}

// The spread of n draws does not grow or fall with n: its square over the variance has mean Student's factor squared.
TEST(DrawSpread, IsThatOfOneDrawWhateverTheirNumber) {
  for (const std::size_t n : {4u, 5u, 6u, 8u, 16u}) {
    double squares = 0;
    constexpr std::uint32_t kSets = 3000;
    for (std::uint32_t set = 0; set < kSets; ++set) {
      const RandomStream random(49, Purpose::test, 3, set);
      std::vector<double> values;
      for (std::uint32_t i = 0; i < n; ++i) values.push_back(3.0 + 0.7 * static_cast<double>(random.normal2(i)[0]));
      squares += std::pow(*spread_of_draws(values), 2) / kSets;
    }
    EXPECT_NEAR(std::sqrt(squares) / student_factor(static_cast<double>(n) - 1), 0.7, 0.035) << n;
  }
  for (const std::size_t n : {0u, 1u, 2u, 3u}) EXPECT_FALSE(spread_of_draws(std::vector<double>(n, 1.0))) << n;
}

}  // namespace
}  // namespace earshot
