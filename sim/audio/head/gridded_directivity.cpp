// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/gridded_directivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/audio/measured/angle_grid.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kLeastFront = 1e-3, kLeastHeard = 0.01, kLeastBalance = 0.75;

class GriddedDirectivity final : public Directivity {
 public:
  GriddedDirectivity(std::vector<double> log_frequency, std::vector<float> pressure)
      : log_frequency_(std::move(log_frequency)), pressure_(std::move(pressure)) {
    cell_edge_hz_.push_back(0.0);
    for (std::size_t f = 1; f < log_frequency_.size(); ++f)
      cell_edge_hz_.push_back(std::exp(0.5 * (log_frequency_[f - 1] + log_frequency_[f])));
    cell_edge_hz_.push_back(std::numeric_limits<double>::infinity());
  }

  [[nodiscard]] float pressure(glm::vec3 direction, float frequency_hz) const override {
    const double frequency = std::log(std::max(static_cast<double>(frequency_hz), 1e-3));
    const std::size_t above = lines_up_to(frequency);
    const std::size_t low = above == 0 ? 0 : above - 1, high = std::min(above, log_frequency_.size() - 1);
    const AngleGrid::Place<double> place = AngleGrid::find<double>(direction);
    const double a = at(low, place);
    if (low == high) return static_cast<float>(a);
    const double b = at(high, place), up = (frequency - log_frequency_[low]) / (log_frequency_[high] - log_frequency_[low]);
    return static_cast<float>(std::copysign((1 - up) * std::abs(a) + up * std::abs(b), up < 0.5 ? a : b));
  }

  void band_pressure(FrequencyRange band, std::span<float> at_nodes) const override {
    const double low_hz = band.low_hz, high_hz = band.high_hz;
    const std::size_t first = lines_up_to(std::log(low_hz)), last = lines_up_to(std::log(high_hz));
    if (last < first + 2) return Directivity::band_pressure(band, at_nodes);
    std::vector<double> power(AngleGrid::kNodes), balance(AngleGrid::kNodes);
    double width = 0;
    // A line beside the band counts as far as its cell reaches into it.
    for (std::size_t f = first == 0 ? 0 : first - 1; f < std::min(last + 1, log_frequency_.size()); ++f) {
      const double weight = std::max(0.0, std::min(cell_edge_hz_[f + 1], high_hz) - std::max(cell_edge_hz_[f], low_hz));
      width += weight;
      for (std::size_t node = 0; node < AngleGrid::kNodes; ++node) {
        const double value = pressure_[f * AngleGrid::kNodes + node];
        power[node] += weight * value * value;
        balance[node] += weight * value * std::abs(value);
      }
    }
    const double heard = kLeastHeard * *std::ranges::max_element(power);
    bool has_signs = true;
    for (std::size_t node = 0; node < AngleGrid::kNodes; ++node)
      has_signs &= power[node] <= heard || std::abs(balance[node]) >= kLeastBalance * power[node];
    for (std::size_t node = 0; node < AngleGrid::kNodes; ++node) {
      const double gain = std::sqrt(power[node] / width);
      at_nodes[node] = static_cast<float>(has_signs ? std::copysign(gain, balance[node]) : gain);
    }
  }

 private:
  /// Number of lines at or below a frequency.
  [[nodiscard]] std::size_t lines_up_to(double log_frequency) const {
    return static_cast<std::size_t>(std::ranges::upper_bound(log_frequency_, log_frequency) - log_frequency_.begin());
  }
  [[nodiscard]] double at(std::size_t frequency, const AngleGrid::Place<double>& place) const {
    const auto value = [&](std::size_t corner) {
      return static_cast<double>(pressure_[frequency * AngleGrid::kNodes + place.node[corner]]);
    };
    return place.between(value(0), value(1), value(2), value(3));
  }

  std::vector<double> log_frequency_;
  std::vector<double> cell_edge_hz_;  ///< between two lines their geometric mean; one more than lines
  std::vector<float> pressure_;       ///< [frequency][node of AngleGrid]
};

}  // namespace

std::shared_ptr<const Directivity> directivity_on_grid(std::vector<double> frequency_hz, const PressureByDirection& pressure,
                                                       const std::string& where) {
  constexpr std::size_t nodes = AngleGrid::kNodes, last_row = nodes - AngleGrid::kColumns;
  const std::size_t frequencies = frequency_hz.size();
  std::vector<double> raw(frequencies * nodes), values(frequencies);
  for (std::size_t node = 0; node < nodes; ++node) {
    const bool repeats_pole = (node > 0 && node < AngleGrid::kColumns) || node > last_row;
    if (!repeats_pole) pressure(AngleGrid::direction(node), values);
    for (std::size_t f = 0; f < frequencies; ++f) raw[f * nodes + node] = values[f];
  }
  std::vector<float> relative(raw.size());
  for (std::size_t f = 0; f < frequencies; ++f) {
    const std::span<const double> all = std::span<const double>(raw).subspan(f * nodes, nodes);
    const double front = all[AngleGrid::kFront];
    double largest = 0;
    for (const double value : all) largest = std::max(largest, std::abs(value));
    if (!(std::abs(front) > kLeastFront * largest))
      throw InputError(where, fmt::format("has no level in front at {:.0f} Hz, to which gains could be relative", frequency_hz[f]),
                       "turn the source so that its front radiates");
    for (std::size_t node = 0; node < nodes; ++node) relative[f * nodes + node] = static_cast<float>(all[node] / front);
  }
  for (double& value : frequency_hz) value = std::log(value);
  return std::make_shared<const GriddedDirectivity>(std::move(frequency_hz), std::move(relative));
}

}  // namespace earshot
