// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

namespace earshot {

/// Mean of values that belong to places.  The values of one place hang together (bands share their rays and their cells), so that the
/// standard error comes from the spread of the places' means.
class PlaceMean {
 public:
  explicit PlaceMean(std::size_t places) : places_(places) {}
  void add(std::size_t place, double value);
  [[nodiscard]] int count() const { return all_.count; }
  [[nodiscard]] double mean() const;            ///< NaN without a value
  [[nodiscard]] double standard_error() const;  ///< 0 with one place, NaN without a value

 private:
  struct Sum {
    double sum = 0;
    int count = 0;
    void add(double value) { sum += value, ++count; }
    [[nodiscard]] double value() const { return sum / count; }
  };
  Sum all_;
  std::vector<Sum> places_;
};

/// Root of a mean square that noise may have made negative, which counts as 0.
struct RootMeanSquare {
  double value = 0;
  double standard_error = 0;  ///< increase of the root by one standard error of the mean square
};
/// Root of the mean and of `sigmas` of its standard errors; NaN without a value.
RootMeanSquare root_mean_square(const PlaceMean& squares, double sigmas = 0);

/// Products of the differences of a test to two independent estimates of a truth, which have the mean square of test less truth as their
/// mean, whatever the noise of the two (cross-validated distances: Walther et al. 2016, NeuroImage 137, 188-200); and with two independent
/// draws of the test apart into what both have in common and what they scatter by.
struct CrossValidatedSquare {
  double square = 0;    ///< mean over the draws: bias and variance
  double bias = 0;      ///< (first draw less one truth)(second draw less the other), both ways round
  double variance = 0;  ///< of one draw: square less bias, which no noise of the truth enters for plain differences
};
/// p_xy: (draw x less one truth)(draw y less the other), or what stands for that product (a mean over the samples of a curve).
inline CrossValidatedSquare cross_validate(double p_11, double p_22, double p_12, double p_21) {
  const double square = 0.5 * (p_11 + p_22), bias = 0.5 * (p_12 + p_21);
  return {square, bias, square - bias};
}

}  // namespace earshot
