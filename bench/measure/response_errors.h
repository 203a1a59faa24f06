// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "bench/measure/response_values.h"

namespace earshot {

/// Root mean square in dB between the decay curves of two series of the same bins (decay_product).
std::optional<double> decay_rms_db(std::span<const double> reference, std::span<const double> test, double range_db = 30);

/// Root mean square in dB between two pooled log(1 + x) spectrograms of the same shape, over the pixels whose reference lies within
/// range_db of its loudest.  Quieter pixels of the test count as that floor.  nullopt if the reference is silent.
std::optional<double> log_spectral_distance_db(std::span<const float> reference, std::span<const float> test, double range_db = 40);

/// Errors of one response at one pose against one reference.  Relative ones as fractions, differences as they come, both with a sign (test
/// minus reference); of curves the root mean square, without.  If the reference has a value and the test does not, the entry is NaN.
struct PoseErrors {
  std::vector<double> values[kNumErrorKinds];  ///< over bands, or one; empty where the reference has no value
};
PoseErrors compare(const HeardResponse& reference, const HeardResponse& test);

/// Over poses and bands: all values weigh the same.
struct ErrorSummary {
  double mean = 0, standard_error = 0;  ///< of absolute values; error: from the spread of the poses' means, NaN with one pose
  double rms = 0, rms_error = 0;        ///< and its standard error, where it is cross-validated
  double signed_mean = 0;               ///< NaN for curves
  double bias = 0, bias_error = 0;      ///< root mean square of what two draws have in common; of what one draw scatters:
  double deviation = 0;
  double p50 = 0, p95 = 0;  ///< of absolute values
  int count = 0, missing = 0;
};
/// Of one draw against one reference: rms is that of the values, bias and deviation are NaN.
ErrorSummary summarise(std::span<const PoseErrors> poses, ErrorKind kind);

/// The truth at one pose: two independent halves, and both together.
struct TruthValues {
  ResponseValues first, second, mean;
};
/// Two draws of a mode, of seeds of their own, at one pose.
using DrawnValues = std::array<ResponseValues, 2>;

/// Absolute values against the mean of the truth, in the unit of files, of both draws at all poses; missing ones are left out.
std::vector<double> error_sizes(std::span<const TruthValues> truth, std::span<const DrawnValues> test, ErrorKind kind, int band = -1);
/// Of two draws against two halves: rms, bias and deviation are cross-validated (sim/acoustics/accuracy/cross_validation.h), so that the
/// noise of the truth is in none of them; mean, signed_mean and percentiles are taken against the mean of both halves.  A value that one
/// draw lacks where both halves have it is missing.  truth, test: by pose.  band: one of them, or all.
ErrorSummary summarise(std::span<const TruthValues> truth, std::span<const DrawnValues> test, ErrorKind kind, int band = -1);
/// Half the difference of the two halves, root mean square over poses and bands: the standard error of a value of their mean.
double truth_error(std::span<const TruthValues> truth, ErrorKind kind);

}  // namespace earshot
