// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/gridded_directivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kQuarterSteps = 18, kGridRows = 2 * kQuarterSteps + 1, kGridColumns = 4 * kQuarterSteps;
constexpr double kGridStepRad = 0.5 * std::numbers::pi / kQuarterSteps;
constexpr double kLeastFront = 1e-3;

class GriddedDirectivity final : public Directivity {
 public:
  GriddedDirectivity(std::vector<double> log_frequency, std::vector<float> pressure)
      : log_frequency_(std::move(log_frequency)), pressure_(std::move(pressure)) {}

  [[nodiscard]] float pressure(glm::vec3 direction, float frequency_hz) const override {
    const double frequency = std::log(std::max(static_cast<double>(frequency_hz), 1e-3));
    const auto above = static_cast<std::size_t>(std::ranges::upper_bound(log_frequency_, frequency) - log_frequency_.begin());
    const std::size_t low = above == 0 ? 0 : above - 1, high = std::min(above, log_frequency_.size() - 1);
    const double a = at(low, direction);
    if (low == high) return static_cast<float>(a);
    const double b = at(high, direction), up = (frequency - log_frequency_[low]) / (log_frequency_[high] - log_frequency_[low]);
    return static_cast<float>(std::copysign((1 - up) * std::abs(a) + up * std::abs(b), up < 0.5 ? a : b));
  }

 private:
  [[nodiscard]] double at(std::size_t frequency, glm::vec3 direction) const {
    const glm::dvec3 d(direction);
    const double height = std::atan2(d.y, std::hypot(d.x, d.z)) / kGridStepRad + kQuarterSteps;
    const double around = std::atan2(-d.x, -d.z) / kGridStepRad + kGridColumns;  // at least half a turn, never negative
    const std::size_t row = std::min(static_cast<std::size_t>(std::max(height, 0.0)), kGridRows - 2);
    const auto column = static_cast<std::size_t>(around);
    const double up = std::clamp(height - static_cast<double>(row), 0.0, 1.0), left = around - static_cast<double>(column);
    const auto along = [&](std::size_t r) {
      const auto cell = [&](std::size_t c) {
        return static_cast<double>(pressure_[(frequency * kGridRows + r) * kGridColumns + c % kGridColumns]);
      };
      return (1 - left) * cell(column) + left * cell(column + 1);
    };
    return (1 - up) * along(row) + up * along(row + 1);
  }

  std::vector<double> log_frequency_;
  std::vector<float> pressure_;  ///< [frequency][elevation][azimuth]
};

}  // namespace

std::shared_ptr<const Directivity> directivity_on_grid(std::vector<double> frequency_hz, const PressureByDirection& pressure,
                                                       const std::string& where) {
  const std::size_t frequencies = frequency_hz.size();
  std::vector<double> raw(frequencies * kGridRows * kGridColumns), values(frequencies);
  for (std::size_t row = 0; row < kGridRows; ++row) {
    const double elevation = (static_cast<double>(row) - kQuarterSteps) * kGridStepRad;
    const bool is_pole = row == 0 || row + 1 == kGridRows;
    const double level = is_pole ? 0.0 : std::cos(elevation);
    for (std::size_t column = 0; column < kGridColumns; ++column) {
      const double azimuth = static_cast<double>(column) * kGridStepRad;
      if (!is_pole || column == 0)
        pressure({static_cast<float>(-level * std::sin(azimuth)), static_cast<float>(std::sin(elevation)),
                  static_cast<float>(-level * std::cos(azimuth))},
                 values);
      for (std::size_t f = 0; f < frequencies; ++f) raw[(f * kGridRows + row) * kGridColumns + column] = values[f];
    }
  }
  std::vector<float> relative(raw.size());
  for (std::size_t f = 0; f < frequencies; ++f) {
    const auto first = raw.begin() + static_cast<std::ptrdiff_t>(f * kGridRows * kGridColumns);
    const double front = first[kQuarterSteps * kGridColumns];
    double largest = 0;
    for (std::size_t i = 0; i < kGridRows * kGridColumns; ++i) largest = std::max(largest, std::abs(first[static_cast<std::ptrdiff_t>(i)]));
    if (!(std::abs(front) > kLeastFront * largest))
      throw InputError(where, fmt::format("has no level in front at {:.0f} Hz, to which gains could be relative", frequency_hz[f]),
                       "turn the source so that its front radiates");
    for (std::size_t i = 0; i < kGridRows * kGridColumns; ++i)
      relative[f * kGridRows * kGridColumns + i] = static_cast<float>(first[static_cast<std::ptrdiff_t>(i)] / front);
  }
  for (double& value : frequency_hz) value = std::log(value);
  return std::make_shared<const GriddedDirectivity>(std::move(frequency_hz), std::move(relative));
}

}  // namespace earshot
