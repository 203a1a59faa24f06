// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_reading.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/accuracy/cross_validation.h"
#include "sim/acoustics/metrics/energy_series.h"
#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot {
namespace {

constexpr double kStepS = 0.004, kLongestS = 4, kRangeDb = 30;
constexpr float kEndedDb = -60;
constexpr double kNoDecay = 1, kNoRatioDb = 10;  ///< errors of what is missing

struct Mean {
  double sum = 0;
  int count = 0;
  void add(double value) { sum += value, ++count; }
  [[nodiscard]] double value() const { return sum / count; }
};

/// Mean over time of the product of the differences to two curves; nullopt where there is nothing to compare.
std::optional<double> curve_product(std::span<const float> test, std::span<const float> first, std::span<const float> second) {
  if (first.empty() || second.empty()) return std::nullopt;
  if (test.empty()) return double{kEndedDb} * kEndedDb;
  Mean square;
  for (std::size_t i = 0; i < first.size(); ++i) {
    const float level = 0.5f * (first[i] + second[i]);
    if (level < -kRangeDb) break;
    // Before the first arrival all are 0 dB, which says nothing about the decays.
    if (level == 0.f && i + 1 < first.size() && first[i + 1] + second[i + 1] == 0.f) continue;
    square.add((double{test[i]} - first[i]) * (double{test[i]} - second[i]));
  }
  if (square.count == 0) return std::nullopt;
  return square.value();
}

}  // namespace

AccuracyReading read_accuracy(const AcousticScene& scene, const EnergyResponse& response) {
  AccuracyReading reading;
  for (const BandMetrics& band : measure(scene, response).bands) {
    reading.t20_s.push_back(band.t20_s);
    reading.drr_db.push_back(band.drr_db);
  }
  constexpr int steps = static_cast<int>(kLongestS / kStepS);
  std::vector<double> curve(steps);
  for (int band = 0; band < scene.num_bands(); ++band) {
    energy_decay_curve(energy_series(response, band, kStepS, steps), curve);
    std::vector<float>& levels = reading.edc_db.emplace_back();
    if (!(curve[0] > 0)) continue;
    for (const double left : curve)
      levels.push_back(left > 0 ? std::max(static_cast<float>(10 * std::log10(left / curve[0])), kEndedDb) : kEndedDb);
  }
  return reading;
}

AccuracyErrors errors_between(std::span<const AccuracyReading> test, std::span<const AccuracyReading> first,
                              std::span<const AccuracyReading> second, double sigmas) {
  PlaceMean t20(first.size()), drr(first.size()), edc(first.size());
  for (std::size_t i = 0; i < test.size(); ++i) {
    const std::size_t place = i % first.size();
    const AccuracyReading &tested = test[i], &first_half = first[place], &second_half = second[place];
    for (std::size_t band = 0; band < tested.t20_s.size(); ++band) {
      if (first_half.t20_s[band] && second_half.t20_s[band])
        t20.add(place, tested.t20_s[band]
                           ? (*tested.t20_s[band] / *first_half.t20_s[band] - 1) * (*tested.t20_s[band] / *second_half.t20_s[band] - 1)
                           : kNoDecay * kNoDecay);
      if (first_half.drr_db[band] && second_half.drr_db[band])
        drr.add(place, tested.drr_db[band]
                           ? (*tested.drr_db[band] - *first_half.drr_db[band]) * (*tested.drr_db[band] - *second_half.drr_db[band])
                           : kNoRatioDb * kNoRatioDb);
      if (const auto product = curve_product(tested.edc_db[band], first_half.edc_db[band], second_half.edc_db[band]))
        edc.add(place, *product);
    }
  }
  return {root_mean_square(t20, sigmas).value, root_mean_square(drr, sigmas).value, root_mean_square(edc, sigmas).value};
}

AccuracyErrors half_difference(std::span<const AccuracyReading> first, std::span<const AccuracyReading> second) {
  AccuracyErrors errors = errors_between(first, second, second);
  for (double& error : errors) error *= 0.5;
  return errors;
}

}  // namespace earshot
