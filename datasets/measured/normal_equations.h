// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace earshot {

/// A symmetric positive definite matrix of few rows, for least squares.
class NormalEquations {
 public:
  explicit NormalEquations(std::size_t size) : size_(size), matrix_(size * size, 0.0), right_(size, 0.0) {}
  /// Adds one weighted residual: its derivatives and its value.
  void add(std::span<const double> derivatives, double residual);
  /// Adds to the diagonal: factor times what is there.
  void damp(double factor);
  /// The step that brings the residuals to zero as far as it can; nullopt if the matrix is not positive definite.
  [[nodiscard]] std::optional<std::vector<double>> step() const;
  /// Diagonal of the inverse; nullopt as above.
  [[nodiscard]] std::optional<std::vector<double>> variances() const;

 private:
  /// Lower factor of Cholesky, row by row.
  [[nodiscard]] std::optional<std::vector<double>> factor() const;
  [[nodiscard]] std::vector<double> solve(std::span<const double> factor, std::vector<double> right) const;

  std::size_t size_;
  std::vector<double> matrix_, right_;
};

}  // namespace earshot
