// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/node_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

constexpr std::size_t kRows = 73;
constexpr double kStep = std::numbers::pi / (kRows - 1);

/// Where each row begins, and where the last one ends.
using RowStarts = std::array<std::size_t, kRows + 1>;
RowStarts count_rows() {
  RowStarts starts{};
  for (std::size_t row = 0; row < kRows; ++row) {
    const double around = 2.0 * std::numbers::pi * std::sin(kStep * static_cast<double>(row));
    starts[row + 1] = starts[row] + std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(around / kStep - 1e-6)));
  }
  return starts;
}
const RowStarts& row_starts() {
  static const RowStarts starts = count_rows();
  return starts;
}

}  // namespace

std::size_t NodeGrid::num_nodes() { return row_starts().back(); }

glm::vec3 NodeGrid::direction(std::size_t node) {
  const RowStarts& starts = row_starts();
  const auto row = static_cast<std::size_t>(std::ranges::upper_bound(starts, node) - starts.begin()) - 1;
  const double elevation = kStep * static_cast<double>(row) - 0.5 * std::numbers::pi;
  const double azimuth =
      2.0 * std::numbers::pi * static_cast<double>(node - starts[row]) / static_cast<double>(starts[row + 1] - starts[row]);
  return {-std::cos(elevation) * std::sin(azimuth), std::sin(elevation), -std::cos(elevation) * std::cos(azimuth)};
}

NodeGrid::Place NodeGrid::find(glm::dvec3 towards) {
  const RowStarts& starts = row_starts();
  // By the arc tangent: near a pole the arc sine of a float is good to 0.02 degrees only.
  const double height = (std::atan2(towards.y, std::hypot(towards.x, towards.z)) + 0.5 * std::numbers::pi) / kStep;
  double turn = std::atan2(-towards.x, -towards.z) / (2.0 * std::numbers::pi);
  turn -= std::floor(turn);
  const auto low = static_cast<std::size_t>(std::clamp(height, 0.0, static_cast<double>(kRows) - 2.0));
  const double up = std::clamp(height - static_cast<double>(low), 0.0, 1.0);
  Place place{};
  for (std::size_t i = 0; i < 2; ++i) {
    const std::size_t first = starts[low + i], count = starts[low + i + 1] - first;
    const double along = turn * static_cast<double>(count);
    const auto left = std::min(static_cast<std::size_t>(along), count - 1);
    const double part = std::min(along - static_cast<double>(left), 1.0), of_row = i == 0 ? 1.0 - up : up;
    place.node[2 * i] = first + left;
    place.node[2 * i + 1] = first + (left + 1) % count;
    place.weight[2 * i] = static_cast<float>(of_row * (1.0 - part));
    place.weight[2 * i + 1] = static_cast<float>(of_row * part);
  }
  return place;
}

}  // namespace earshot
