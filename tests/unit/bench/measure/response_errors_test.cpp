// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/response_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "sim/acoustics/metrics/energy_series.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Bins that decay by `db_per_bin`; the decay curve of an endless one falls by as much.
std::vector<double> decay(double db_per_bin, int bins) {
  std::vector<double> series;
  for (int i = 0; i < bins; ++i) series.push_back(std::pow(10.0, -db_per_bin * i / 10));
  return series;
}

// Curves of -1 and -1.2 dB per bin: after i bins they differ by 0.2 i dB.  The reference is above -30 dB for i = 0 ... 30:
// rms = 0.2 sqrt(sum i^2 / 31) = 0.2 sqrt(30 * 31 * 61 / 6 / 31) = 0.2 sqrt(305) = 3.4928.
TEST(DecayRms, OfTwoExponentialDecays) {
  const auto rms = decay_rms_db(decay(1, 400), decay(1.2, 400));
  ASSERT_TRUE(rms.has_value());
  EXPECT_NEAR(*rms, 0.2 * std::sqrt(305.0), 1e-6);  // what the series cut off lies at -400 dB
}

TEST(DecayRms, DoesNotDependOnLevelAndVanishesForTheSame) {
  std::vector<double> louder = decay(1, 400);
  for (double& value : louder) value *= 7;
  EXPECT_NEAR(*decay_rms_db(decay(1, 400), louder), 0, 1e-9);
  EXPECT_FALSE(decay_rms_db(decay(1, 4), std::vector<double>(4, 0.0)).has_value());
  EXPECT_FALSE(decay_rms_db(std::vector<double>(4, 0.0), decay(1, 4)).has_value());
  EXPECT_THROW(static_cast<void>(decay_rms_db(decay(1, 4), decay(1, 5))), InputError);
}

// Silence before the first arrival counts for nothing: two bins of delay on both sides leave the same rms.
TEST(DecayRms, SilenceBeforeTheSoundIsNoAgreement) {
  std::vector<double> reference = decay(1, 400), test = decay(1.2, 400);
  reference.insert(reference.begin(), 2, 0.0);
  test.insert(test.begin(), 2, 0.0);
  EXPECT_NEAR(*decay_rms_db(reference, test), 0.2 * std::sqrt(305.0), 1e-6);
}

// A response that stops after one bin counts as -60 dB from there on.  Reference energies 8, 1, 1: its curve is 10, 2, 1, so 0, -6.9897 and
// -10 dB; the test's is 0, -60, -60.
TEST(DecayRms, AnEndedResponseCountsAsMinusSixty) {
  const std::vector<double> reference{8, 1, 1}, test{1, 0, 0};
  const double a = 60 - 6.98970004336, b = 60 - 10.0;
  EXPECT_NEAR(*decay_rms_db(reference, test), std::sqrt((0 + a * a + b * b) / 3), 1e-6);
}

TEST(EnergySeries, ArrivalsAndLateBinsFallWhereTheyBelong) {
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 340;
  Arrival arrival;
  arrival.distance_m = 3.4f;  // 10 ms: bin 2 of 4 ms
  arrival.amplitude[1] = 0.5f;
  response.arrivals.push_back(arrival);
  response.late = EnergyHistogram(4, 2, 0, 0.008f);
  response.late.values()[1 * 2 + 1] = 3.f;  // bin 1, band 1: 8 to 16 ms, half of it in each of bins 2 and 3
  const std::vector<double> series = energy_series(response, 1, 0.004, 6);
  ASSERT_EQ(series.size(), 6u);
  EXPECT_NEAR(series[2], 0.25 + 1.5, 1e-6);
  EXPECT_NEAR(series[3], 1.5, 1e-6);
  EXPECT_NEAR(series[0] + series[1] + series[4] + series[5], 0, 1e-6);
  EXPECT_NEAR(energy_series(response, 0, 0.004, 6)[2], 0, 1e-12);
}

TEST(EnergySeries, FineLateBinsAreSummed) {
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 340;
  response.late = EnergyHistogram(8, 1, 0, 0.001f);
  for (float& value : response.late.values()) value = 1.f;
  const std::vector<double> series = energy_series(response, 0, 0.004, 3);
  EXPECT_NEAR(series[0], 4, 1e-4);
  EXPECT_NEAR(series[1], 4, 1e-4);
  EXPECT_NEAR(series[2], 0, 1e-4);
}

// log(1 + x) of magnitudes 1, 0.1 and 0.001 (60 dB down, out of range) against 2, 0.1, 1: only the first differs, by 6.0206 dB.
TEST(LogSpectralDistance, OfHandMadePixels) {
  const auto pixel = [](double x) { return static_cast<float>(std::log1p(x)); };
  const std::vector<float> reference{pixel(1), pixel(0.1), pixel(0.001)}, test{pixel(2), pixel(0.1), pixel(1)};
  EXPECT_NEAR(*log_spectral_distance_db(reference, test), 20 * std::log10(2.0) / std::sqrt(2.0), 1e-4);
  EXPECT_FALSE(log_spectral_distance_db(std::vector<float>(3, 0.f), test).has_value());
  // A silent test is heard as the floor, 40 dB under the loudest: 40 and 20 dB.
  EXPECT_NEAR(*log_spectral_distance_db(reference, std::vector<float>(3, 0.f)), std::sqrt((1600.0 + 400.0) / 2), 1e-2);
}

/// What is heard at one pose, with one decay time in two bands.
HeardResponse heard(std::optional<double> t20_low_s, std::optional<double> t20_high_s, std::optional<double> drr_db) {
  HeardResponse response;
  response.energy.bands_hz = {1000, 2000};
  response.energy.bands.resize(2);
  response.energy.bands[0].t20_s = t20_low_s;
  response.energy.bands[1].t20_s = t20_high_s;
  response.energy.drr_db = drr_db;
  response.series = {decay(1, 50), decay(1, 50)};
  response.rir = response.energy;
  return response;
}

TEST(Compare, RelativeErrorsDifferencesAndWhatIsMissing) {
  const PoseErrors errors = compare(heard(0.5, 0.8, 3), heard(0.6, std::nullopt, 1));
  const auto& t20 = errors.values[static_cast<int>(ErrorKind::t20)];
  ASSERT_EQ(t20.size(), 2u);
  EXPECT_NEAR(t20[0], 0.2, 1e-12);
  EXPECT_TRUE(std::isnan(t20[1]));
  EXPECT_EQ(errors.values[static_cast<int>(ErrorKind::drr_db)], std::vector<double>{-2});
  EXPECT_TRUE(compare(heard(std::nullopt, 0.8, {}), heard(0.6, 0.8, 1)).values[static_cast<int>(ErrorKind::drr_db)].empty());
}

// The rendered RIR is held against the truth's energy response: its own noise counts.
TEST(Compare, RenderedDecayTimesAreHeldAgainstTheEnergyOfTheTruth) {
  HeardResponse truth = heard(0.5, 0.8, 0), test = heard(0.5, 0.8, 0);
  truth.rir.bands[0].t20_s = 9;    // plays no part in the first
  test.rir.bands_hz = {63, 1000};  // its octaves are others
  test.rir.bands[1].t20_s = 0.45;
  const PoseErrors errors = compare(truth, test);
  ASSERT_EQ(errors.values[static_cast<int>(ErrorKind::rir_t20)].size(), 2u);
  EXPECT_NEAR(errors.values[static_cast<int>(ErrorKind::rir_t20)][0], -0.1, 1e-9);
  EXPECT_TRUE(std::isnan(errors.values[static_cast<int>(ErrorKind::rir_t20)][1]));  // no octave of the test lies there
  // Against the rendered truth the 9 s do play a part.
  ASSERT_EQ(errors.values[static_cast<int>(ErrorKind::rir_to_rir_t20)].size(), 2u);
  EXPECT_NEAR(errors.values[static_cast<int>(ErrorKind::rir_to_rir_t20)][0], 0.45 / 9 - 1, 1e-9);
}

TEST(Compare, OtherBandsAreComparedByWhatIsHeardAlone) {
  HeardResponse test = heard(0.5, 0.8, 0);
  test.energy.bands_hz = {500, 4000};
  const PoseErrors errors = compare(heard(0.5, 0.8, 0), test);
  EXPECT_TRUE(errors.values[static_cast<int>(ErrorKind::t20)].empty());
  EXPECT_EQ(errors.values[static_cast<int>(ErrorKind::rir_t20)].size(), 2u);
}

// Poses with errors (0.1, -0.3) and (0.2, missing): mean 0.2, rms sqrt(0.14 / 3), means of the poses 0.2 and 0.2, so no spread; a third
// pose of 0.5 makes them 0.2, 0.2, 0.5: mean 0.3, standard error sqrt((0.01 + 0.01 + 0.04) / (3 * 2)) = 0.1.
TEST(Summarise, MeanRmsPercentileAndStandardErrorByHand) {
  const auto pose = [](std::vector<double> values) {
    PoseErrors errors;
    errors.values[static_cast<int>(ErrorKind::t20)] = std::move(values);
    return errors;
  };
  std::vector<PoseErrors> poses{pose({0.1, -0.3}), pose({0.2, kNan})};
  ErrorSummary summary = summarise(poses, ErrorKind::t20);
  EXPECT_NEAR(summary.mean, 0.2, 1e-12);
  EXPECT_NEAR(summary.rms, std::sqrt(0.14 / 3), 1e-12);
  EXPECT_NEAR(summary.p95, 0.3, 1e-12);
  EXPECT_NEAR(summary.standard_error, 0, 1e-12);
  EXPECT_EQ(summary.count, 3);
  EXPECT_EQ(summary.missing, 1);
  poses.push_back(pose({0.5}));
  summary = summarise(poses, ErrorKind::t20);
  EXPECT_NEAR(summary.standard_error, 0.1, 1e-12);
  EXPECT_TRUE(std::isnan(summarise(poses, ErrorKind::drr_db).mean));
  EXPECT_TRUE(std::isnan(summarise(std::vector{pose({0.5})}, ErrorKind::t20).standard_error));
}

}  // namespace
}  // namespace earshot
