// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/response_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/measure/measured.h"
#include "sim/acoustics/accuracy/cross_validation.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

std::vector<double> levels_db(std::span<const float> spectrogram) {
  HeardResponse heard;
  heard.spectrogram.assign(spectrogram.begin(), spectrogram.end());
  return truth_values(heard).of(ErrorKind::spectral_db).front();
}

std::optional<double> root(const std::optional<double>& square) {
  return square ? std::optional(std::sqrt(std::max(*square, 0.0))) : std::nullopt;
}

/// Error of one item, with a sign unless it is a curve's; NaN if the test has no value.  reference: not empty.
std::optional<double> item_error(ErrorKind kind, std::span<const double> test, std::span<const double> reference) {
  const ErrorKindFacts& facts = facts_of(kind);
  if (facts.curve) return root(difference_product(kind, test, test, reference, reference));
  if (test.empty()) return kMissing;
  return facts.relative ? test[0] / reference[0] - 1 : test[0] - reference[0];
}

/// mean, its error, percentiles, count, missing, and the plain root mean square.  by_pose: signed or not.
ErrorSummary summarise_sizes(const std::vector<std::vector<double>>& by_pose, bool has_sign) {
  ErrorSummary summary;
  std::vector<double> sizes;
  // Of the means of the poses, which all weigh the same in the standard error.
  PlaceMean pose_mean(by_pose.size());
  double sum = 0, squares = 0, signed_sum = 0;
  std::size_t poses = 0;
  for (std::size_t p = 0; p < by_pose.size(); ++p) {
    double pose_sum = 0;
    int count = 0;
    for (const double error : by_pose[p]) {
      if (std::isnan(error)) {
        ++summary.missing;
        continue;
      }
      sizes.push_back(std::abs(error));
      pose_sum += std::abs(error), ++count;
      squares += error * error;
      signed_sum += error;
    }
    sum += pose_sum;
    if (count > 0) pose_mean.add(p, pose_sum / count), ++poses;
  }
  summary.count = static_cast<int>(sizes.size());
  summary.rms_error = summary.bias = summary.bias_error = summary.deviation = kMissing;
  if (sizes.empty()) {
    summary.mean = summary.rms = summary.signed_mean = summary.p50 = summary.p95 = summary.standard_error = kMissing;
    return summary;
  }
  const auto n = static_cast<double>(sizes.size());
  summary.mean = sum / n;
  summary.standard_error = poses > 1 ? pose_mean.standard_error() : kMissing;
  summary.rms = std::sqrt(squares / n);
  summary.signed_mean = has_sign ? signed_sum / n : kMissing;
  summary.p50 = percentile(sizes, 0.5);
  summary.p95 = percentile(sizes, 0.95);
  return summary;
}

/// Calls use(pose, item) for every item that the mean of the truth and both its halves have, of one band or all.
template <class Use>
void for_items(std::span<const TruthValues> truth, ErrorKind kind, int band, const Use& use) {
  for (std::size_t p = 0; p < truth.size(); ++p) {
    const auto &first = truth[p].first.of(kind), &second = truth[p].second.of(kind), &mean = truth[p].mean.of(kind);
    for (std::size_t i = 0; i < mean.size(); ++i)
      if ((band < 0 || static_cast<std::size_t>(band) == i) && !first[i].empty() && !second[i].empty() && !mean[i].empty()) use(p, i);
  }
}

/// Errors of both draws against the mean of the truth, pose by pose.
std::vector<std::vector<double>> errors_by_pose(std::span<const TruthValues> truth, std::span<const DrawnValues> test, ErrorKind kind,
                                                int band) {
  std::vector<std::vector<double>> errors(truth.size());
  for_items(truth, kind, band, [&](std::size_t p, std::size_t i) {
    for (const ResponseValues& draw : test[p]) {
      const auto& items = draw.of(kind);
      if (items.empty()) continue;  // of other bands: not compared
      if (const auto error = item_error(kind, items[i], truth[p].mean.of(kind)[i])) errors[p].push_back(*error);
    }
  });
  return errors;
}

}  // namespace

std::optional<double> decay_rms_db(std::span<const double> reference, std::span<const double> test, double range_db) {
  require(reference.size() == test.size(), "series", test.size(), "must be as long as the reference");
  const std::vector<double> truth = decay_levels_db(reference), other = decay_levels_db(test);
  if (truth.empty() || other.empty()) return std::nullopt;
  return root(decay_product(other, other, truth, truth, range_db));
}

std::optional<double> log_spectral_distance_db(std::span<const float> reference, std::span<const float> test, double range_db) {
  const std::vector<double> truth = levels_db(reference), other = levels_db(test);
  return root(spectral_product(other, other, truth, truth, range_db));
}

PoseErrors compare(const HeardResponse& reference, const HeardResponse& test) {
  const ResponseValues truth = truth_values(reference), other = test_values(test, reference);
  PoseErrors errors;
  for (const ErrorKind kind : all_error_kinds()) {
    const auto &of_truth = truth.of(kind), &of_test = other.of(kind);
    if (of_test.empty()) continue;
    for (std::size_t i = 0; i < of_truth.size(); ++i)
      if (!of_truth[i].empty())
        if (const auto error = item_error(kind, of_test[i], of_truth[i])) errors.values[static_cast<std::size_t>(kind)].push_back(*error);
  }
  return errors;
}

ErrorSummary summarise(std::span<const PoseErrors> poses, ErrorKind kind) {
  std::vector<std::vector<double>> by_pose;
  for (const PoseErrors& pose : poses) by_pose.push_back(pose.values[static_cast<std::size_t>(kind)]);
  return summarise_sizes(by_pose, !facts_of(kind).curve);
}

std::vector<double> error_sizes(std::span<const TruthValues> truth, std::span<const DrawnValues> test, ErrorKind kind, int band) {
  std::vector<double> sizes;
  for (const std::vector<double>& pose : errors_by_pose(truth, test, kind, band))
    for (const double error : pose)
      if (!std::isnan(error)) sizes.push_back(scale_of(kind) * std::abs(error));
  return sizes;
}

ErrorSummary summarise(std::span<const TruthValues> truth, std::span<const DrawnValues> test, ErrorKind kind, int band) {
  EARSHOT_EXPECT(truth.size() == test.size());
  ErrorSummary summary = summarise_sizes(errors_by_pose(truth, test, kind, band), !facts_of(kind).curve);
  PlaceMean square(truth.size()), bias(truth.size()), variance(truth.size());
  for_items(truth, kind, band, [&](std::size_t p, std::size_t i) {
    const auto &first_run = test[p][0].of(kind), &second_run = test[p][1].of(kind), &a = truth[p].first.of(kind),
               &b = truth[p].second.of(kind);
    if (first_run.empty() || second_run.empty()) return;
    if (!facts_of(kind).curve && (first_run[i].empty() || second_run[i].empty())) return;
    const auto of_one = difference_product(kind, first_run[i], first_run[i], a[i], b[i]),
               of_two = difference_product(kind, second_run[i], second_run[i], a[i], b[i]);
    const auto crossed = difference_product(kind, first_run[i], second_run[i], a[i], b[i]),
               back = difference_product(kind, second_run[i], first_run[i], a[i], b[i]);
    if (!of_one || !of_two || !crossed || !back) return;
    const CrossValidatedSquare parts = cross_validate(*of_one, *of_two, *crossed, *back);
    square.add(p, parts.square);
    bias.add(p, parts.bias);
    variance.add(p, parts.variance);
  });
  const RootMeanSquare of_square = root_mean_square(square), of_bias = root_mean_square(bias);
  summary.rms = of_square.value;
  summary.rms_error = of_square.standard_error;
  summary.bias = of_bias.value;
  summary.bias_error = of_bias.standard_error;
  summary.deviation = root_mean_square(variance).value;
  return summary;
}

double truth_error(std::span<const TruthValues> truth, ErrorKind kind) {
  PlaceMean square(truth.size());
  for_items(truth, kind, -1, [&](std::size_t p, std::size_t i) {
    const auto &a = truth[p].first.of(kind)[i], &b = truth[p].second.of(kind)[i];
    if (const auto product = difference_product(kind, a, a, b, b)) square.add(p, 0.25 * *product);
  });
  return root_mean_square(square).value;
}

}  // namespace earshot
