#include "sim/acoustics/band_filters.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

/// 0 below the crossover around `edge_hz`, 1 above it.
float rise(float edge_hz, float frequency_hz) {
  constexpr float half_width_octaves = 0.25f;
  if (frequency_hz <= 0.f) return 0.f;
  const float position = std::clamp(std::log2(frequency_hz / edge_hz) / half_width_octaves, -1.f, 1.f);
  return 0.5f + 0.5f * std::sin(0.5f * std::numbers::pi_v<float> * position);
}

}  // namespace

float band_weight(const BandLayout& bands, int band, float frequency_hz) {
  // Differences of the rising edges telescope: their sum is 1 whatever the rounding of each.
  const auto index = static_cast<std::size_t>(band);
  const float lower = band == 0 ? 1.f : rise(bands.edge_hz[index], frequency_hz);
  const float upper = band + 1 == bands.size() ? 0.f : rise(bands.edge_hz[index + 1], frequency_hz);
  return std::max(0.f, lower - upper);
}

std::vector<float> band_weights(const BandLayout& bands, float sample_rate_hz, int fft_size) {
  const int num_bins = fft_size / 2 + 1;
  std::vector<float> weights(static_cast<std::size_t>(bands.size()) * static_cast<std::size_t>(num_bins));
  for (int band = 0; band < bands.size(); ++band)
    for (int k = 0; k < num_bins; ++k)
      weights[static_cast<std::size_t>(band * num_bins + k)] = band_weight(bands, band, static_cast<float>(k) * sample_rate_hz / static_cast<float>(fft_size));
  return weights;
}

}  // namespace earshot
