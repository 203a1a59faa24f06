// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/band_filters.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kHalfWidthOctaves = 0.25;

}  // namespace

BandFilters::BandFilters(const BandLayout& bands, float sample_rate_hz, int fft_size, BandShape shape)
    : num_bands_(bands.size()),
      bin_hz_(static_cast<double>(sample_rate_hz) / fft_size),
      lower_(static_cast<std::size_t>(fft_size / 2 + 1), 0),
      upper_weight_(lower_.size(), 0.f) {
  require(num_bands_ >= 1 && num_bands_ <= kMaxBands, "bands", num_bands_, "must be in [1, 32]");
  for (std::size_t k = 1; k < lower_.size(); ++k) {
    if (shape == BandShape::crossover)
      set_crossover(k, bands);
    else
      set_line(k, bands);
  }
}

void BandFilters::set_crossover(std::size_t bin, const BandLayout& bands) {
  const auto width_octaves = [&](int band) { return std::log2(static_cast<double>(bands.edge_hz[band + 1]) / bands.edge_hz[band]); };
  const double frequency_hz = static_cast<double>(bin) * bin_hz_;
  for (int edge = 1; edge < num_bands_; ++edge) {
    // Neighbouring transitions meet at most in the middle of a band, so no more than two bands overlap.
    const double half_width = std::min(kHalfWidthOctaves, 0.5 * std::min(width_octaves(edge - 1), width_octaves(edge)));
    const double x = (std::log2(frequency_hz / bands.edge_hz[edge]) + half_width) / (2.0 * half_width);
    if (x <= 0) break;
    const double sine = std::sin(0.5 * std::numbers::pi * std::min(x, 1.0));
    lower_[bin] = static_cast<std::uint8_t>(x >= 1 ? edge : edge - 1);
    upper_weight_[bin] = x >= 1 ? 0.f : static_cast<float>(sine * sine);
    if (x < 1) break;
  }
}

void BandFilters::set_line(std::size_t bin, const BandLayout& bands) {
  const double frequency_hz = static_cast<double>(bin) * bin_hz_;
  const auto above = std::ranges::upper_bound(bands.centre_hz, frequency_hz);
  if (above == bands.centre_hz.begin()) return;
  lower_[bin] = static_cast<std::uint8_t>(above - bands.centre_hz.begin() - 1);
  if (above == bands.centre_hz.end()) return;
  const double below_hz = double{above[-1]}, above_hz = double{*above};
  upper_weight_[bin] = static_cast<float>(std::log2(frequency_hz / below_hz) / std::log2(above_hz / below_hz));
}

float BandFilters::weight(int band, std::size_t bin) const {
  if (band == lower_[bin]) return 1.f - upper_weight_[bin];
  return band == lower_[bin] + 1 ? upper_weight_[bin] : 0.f;
}

void BandFilters::blend(std::span<const float> value, std::span<float> gain) const {
  EARSHOT_EXPECT(value.size() >= static_cast<std::size_t>(num_bands_) && gain.size() >= lower_.size());
  for (std::size_t k = 0; k < lower_.size(); ++k) {
    const std::size_t lower = lower_[k], upper = std::min<std::size_t>(lower + 1, static_cast<std::size_t>(num_bands_ - 1));
    gain[k] = value[lower] + upper_weight_[k] * (value[upper] - value[lower]);
  }
}

}  // namespace earshot
