// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/direction_weights.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>

namespace earshot {
namespace {

constexpr double kExponent = 1.3;

double variogram(glm::dvec3 a, glm::dvec3 b) {
  const glm::dvec3 chord = a - b;
  return std::pow(glm::dot(chord, chord), 0.5 * kExponent);
}

/// Solves rows [n][n + 1], right side last, by elimination with the largest pivot of each column; leaves the solution in the last column.
void solve(std::vector<double>& rows, std::size_t n) {
  const std::size_t width = n + 1;
  for (std::size_t column = 0; column < n; ++column) {
    std::size_t pivot = column;
    for (std::size_t row = column + 1; row < n; ++row)
      if (std::abs(rows[row * width + column]) > std::abs(rows[pivot * width + column])) pivot = row;
    if (pivot != column) std::swap_ranges(&rows[pivot * width], &rows[pivot * width] + width, &rows[column * width]);
    const double* upper = &rows[column * width];
    for (std::size_t row = column + 1; row < n; ++row) {
      double* lower = &rows[row * width];
      const double factor = lower[column] / upper[column];
      for (std::size_t k = column; k < width; ++k) lower[k] -= factor * upper[k];
    }
  }
  for (std::size_t row = n; row-- > 0;) {
    double value = rows[row * width + n];
    for (std::size_t k = row + 1; k < n; ++k) value -= rows[row * width + k] * rows[k * width + n];
    rows[row * width + n] = value / rows[row * width + row];
  }
}

}  // namespace

DirectionWeights::DirectionWeights(std::span<const glm::vec3> directions) {
  for (const glm::vec3 direction : directions) directions_.push_back(glm::normalize(glm::dvec3(direction)));
}

std::vector<DirectionWeights::Weight> DirectionWeights::at(glm::vec3 towards) const {
  const glm::dvec3 place = glm::normalize(glm::dvec3(towards));
  std::vector<std::pair<double, std::size_t>> nearest(directions_.size());
  for (std::size_t i = 0; i < directions_.size(); ++i) nearest[i] = {-glm::dot(place, directions_[i]), i};
  const std::size_t count = std::min(kNeighbours, nearest.size());
  std::ranges::partial_sort(nearest, nearest.begin() + static_cast<std::ptrdiff_t>(count));
  // The weights w and the multiplier m of their sum: sum_j g(i, j) w_j + m = g(i, place), sum_j w_j = 1.
  const std::size_t n = count + 1, width = n + 1;
  std::vector<double> rows(n * width, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    const glm::dvec3 direction = directions_[nearest[i].second];
    for (std::size_t j = 0; j < i; ++j) rows[i * width + j] = rows[j * width + i] = variogram(direction, directions_[nearest[j].second]);
    rows[i * width + count] = rows[count * width + i] = 1.0;
    rows[i * width + n] = variogram(direction, place);
  }
  rows[count * width + n] = 1.0;
  solve(rows, n);
  std::vector<Weight> weights(count);
  for (std::size_t i = 0; i < count; ++i) weights[i] = {nearest[i].second, rows[i * width + n]};
  return weights;
}

}  // namespace earshot
