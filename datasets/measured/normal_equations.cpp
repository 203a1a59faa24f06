// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/normal_equations.h"

#include <cmath>

namespace earshot {

void NormalEquations::add(std::span<const double> derivatives, double residual) {
  for (std::size_t row = 0; row < size_; ++row) {
    right_[row] -= derivatives[row] * residual;
    for (std::size_t column = 0; column < size_; ++column) matrix_[row * size_ + column] += derivatives[row] * derivatives[column];
  }
}

void NormalEquations::damp(double factor) {
  for (std::size_t i = 0; i < size_; ++i) matrix_[i * size_ + i] *= 1 + factor;
}

std::optional<std::vector<double>> NormalEquations::factor() const {
  std::vector<double> lower(size_ * size_, 0.0);
  for (std::size_t row = 0; row < size_; ++row)
    for (std::size_t column = 0; column <= row; ++column) {
      double sum = matrix_[row * size_ + column];
      for (std::size_t k = 0; k < column; ++k) sum -= lower[row * size_ + k] * lower[column * size_ + k];
      if (row == column && !(sum > 0 && std::isfinite(sum))) return std::nullopt;
      lower[row * size_ + column] = row == column ? std::sqrt(sum) : sum / lower[column * size_ + column];
    }
  return lower;
}

std::vector<double> NormalEquations::solve(std::span<const double> factor, std::vector<double> right) const {
  for (std::size_t row = 0; row < size_; ++row) {
    for (std::size_t k = 0; k < row; ++k) right[row] -= factor[row * size_ + k] * right[k];
    right[row] /= factor[row * size_ + row];
  }
  for (std::size_t row = size_; row-- > 0;) {
    for (std::size_t k = row + 1; k < size_; ++k) right[row] -= factor[k * size_ + row] * right[k];
    right[row] /= factor[row * size_ + row];
  }
  return right;
}

std::optional<std::vector<double>> NormalEquations::step() const {
  const auto lower = factor();
  return lower ? std::optional(solve(*lower, right_)) : std::nullopt;
}

std::optional<std::vector<double>> NormalEquations::variances() const {
  const auto lower = factor();
  if (!lower) return std::nullopt;
  std::vector<double> diagonal;
  for (std::size_t i = 0; i < size_; ++i) {
    std::vector<double> unit(size_, 0.0);
    unit[i] = 1;
    diagonal.push_back(solve(*lower, std::move(unit))[i]);
  }
  return diagonal;
}

}  // namespace earshot
