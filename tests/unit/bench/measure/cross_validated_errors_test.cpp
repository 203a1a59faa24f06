// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "bench/measure/response_errors.h"

namespace earshot {
namespace {

/// `bands` values of one kind.
ResponseValues values_of(ErrorKind kind, const std::vector<double>& bands) {
  ResponseValues values;
  for (const double value : bands) values.of(kind).push_back(std::isnan(value) ? std::vector<double>{} : std::vector<double>{value});
  return values;
}

struct Trial {
  std::vector<TruthValues> truth;
  std::vector<DrawnValues> test;
};

/// Levels of 3,000 poses and two bands: halves of the truth scatter by `truth_noise`, draws of the mode by `noise` about `bias`.
Trial noisy_trial(double truth_noise, double bias, double noise) {
  constexpr int poses = 3000;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto near = [&](double low, double high, double by) {
    return values_of(ErrorKind::level_db, {low + by * normal(random), high + by * normal(random)});
  };
  Trial trial;
  for (int p = 0; p < poses; ++p) {
    const double low = 20 * normal(random), high = 20 * normal(random);
    TruthValues& truth = trial.truth.emplace_back();
    truth.first = near(low, high, truth_noise);
    truth.second = near(low, high, truth_noise);
    truth.mean = truth.first;
    for (std::size_t i = 0; i < 2; ++i)
      truth.mean.of(ErrorKind::level_db)[i][0] =
          0.5 * (truth.first.of(ErrorKind::level_db)[i][0] + truth.second.of(ErrorKind::level_db)[i][0]);
    trial.test.push_back({near(low + bias, high + bias, noise), near(low + bias, high + bias, noise)});
  }
  return trial;
}

// Bias 2, scatter 1.5, truth that scatters by 3 in each half: rms sqrt(4 + 2.25) = 2.5.  Of 6,000 values the standard errors of the three
// are about 0.05, so that 0.2 is four of them, and a root mean square against the mean of the truth, sqrt(6.25 + 4.5) = 3.28, is far off.
TEST(CrossValidatedErrors, GiveBackBiasAndNoiseWhateverTheTruthsNoise) {
  const Trial trial = noisy_trial(3, 2, 1.5);
  const ErrorSummary summary = summarise(trial.truth, trial.test, ErrorKind::level_db);
  EXPECT_LT(summary.rms_error, 0.1);
  EXPECT_NEAR(summary.rms, 2.5, 0.2);
  EXPECT_NEAR(summary.bias, 2, 0.2);
  EXPECT_NEAR(summary.deviation, 1.5, 0.2);
  EXPECT_NEAR(summary.signed_mean, 2, 0.2);
  EXPECT_GT(summary.mean, 2.55);  // sqrt(2 / pi) 3.28 for a centred error, more with a bias: the truth's noise is in it
  EXPECT_EQ(summary.count, 12'000);
  EXPECT_NEAR(truth_error(trial.truth, ErrorKind::level_db), 3 / std::sqrt(2.0), 0.1);  // of the mean of two
}

TEST(CrossValidatedErrors, OfAModeThatOnlyScattersHaveNoBias) {
  const Trial trial = noisy_trial(1, 0, 2);
  const ErrorSummary summary = summarise(trial.truth, trial.test, ErrorKind::level_db);
  EXPECT_NEAR(summary.rms, 2, 0.1);
  EXPECT_LT(summary.bias, 0.5);  // the mean product has a standard error of sqrt(21 / 6000) = 0.06: root of four of them
  EXPECT_NEAR(summary.deviation, 2, 0.1);
}

// By hand: T20 of 1 s in both halves, draws of 1.1 and 0.9 s: errors of 0.1 and -0.1, no bias beyond (0.1)(-0.1) < 0, variance 0.02.
TEST(CrossValidatedErrors, OfOnePoseByHand) {
  TruthValues truth;
  truth.first = truth.second = truth.mean = values_of(ErrorKind::t20, {1, 2});
  const std::vector<TruthValues> truths{truth};
  const std::vector<DrawnValues> draws{{values_of(ErrorKind::t20, {1.1, 2.2}), values_of(ErrorKind::t20, {0.9, std::nan("")})}};
  const ErrorSummary low = summarise(truths, draws, ErrorKind::t20, 0);
  EXPECT_NEAR(low.rms, 0.1, 1e-12);
  EXPECT_EQ(low.bias, 0);
  EXPECT_NEAR(low.deviation, std::sqrt(0.02), 1e-12);
  EXPECT_NEAR(low.signed_mean, 0, 1e-12);
  EXPECT_EQ(low.missing, 0);
  const ErrorSummary high = summarise(truths, draws, ErrorKind::t20, 1);
  EXPECT_EQ(high.missing, 1);
  EXPECT_EQ(high.count, 1);
  EXPECT_TRUE(std::isnan(high.rms));  // a single draw is not a pair
  EXPECT_EQ(summarise(truths, draws, ErrorKind::t20).count, 3);
  EXPECT_EQ(error_sizes(truths, draws, ErrorKind::t20).size(), 3u);
  EXPECT_NEAR(error_sizes(truths, draws, ErrorKind::t20, 1).at(0), 10, 1e-9);  // in the unit of files
}

// Curves 0, -2, -4 dB of the truth; both draws 1 dB above from the second sample on: rms sqrt(2 / 3), all of it bias.
TEST(CrossValidatedErrors, OfCurvesAreMeansOverTheirSamples) {
  const auto curve = [](const std::vector<double>& samples) {
    ResponseValues values;
    values.of(ErrorKind::decay_db).push_back(samples);
    return values;
  };
  TruthValues truth;
  truth.first = truth.second = truth.mean = curve({0, -2, -4});
  const std::vector<TruthValues> truths{truth};
  const std::vector<DrawnValues> draws{{curve({0, -1, -3}), curve({0, -1, -3})}};
  const ErrorSummary summary = summarise(truths, draws, ErrorKind::decay_db);
  EXPECT_NEAR(summary.rms, std::sqrt(2.0 / 3), 1e-12);
  EXPECT_NEAR(summary.bias, std::sqrt(2.0 / 3), 1e-12);
  EXPECT_NEAR(summary.deviation, 0, 1e-12);
  EXPECT_NEAR(summary.mean, std::sqrt(2.0 / 3), 1e-12);
  EXPECT_TRUE(std::isnan(summary.signed_mean));
}

// Half and whole of a response: what arrives in the first 50 ms is D50 of the level.
TEST(ResponseValues, TheEarlyLevelIsTheFractionOfTheWhole) {
  HeardResponse heard;
  heard.energy.bands_hz = {1000};
  heard.energy.bands.resize(1);
  heard.energy.bands[0].g_db = 7;
  heard.energy.bands[0].d50 = 0.5;
  const ResponseValues values = truth_values(heard);
  EXPECT_NEAR(values.of(ErrorKind::early_db).at(0).at(0), 7 - 3.0103, 1e-4);
  EXPECT_TRUE(values.of(ErrorKind::t20).at(0).empty());
}

}  // namespace
}  // namespace earshot
