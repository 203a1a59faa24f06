// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/speech_transmission.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace earshot {

double modulation_transfer(std::span<const double> energy, double bin_s, double direct_energy, double modulation_hz) {
  const double radians = 2.0 * std::numbers::pi * modulation_hz * bin_s, half = 0.5 * radians;
  const std::complex<double> turn = std::polar(1.0, -radians);
  std::complex<double> sum = 0, phase = std::polar(std::sin(half) / half, -half);  // mean over the first bin
  double total = direct_energy;
  for (const double value : energy) {
    sum += value * phase;
    total += value;
    phase *= turn;
  }
  return total > 0 && std::isfinite(total) ? std::abs(sum + direct_energy) / total : 0.0;
}

std::optional<double> modulation_transfer_index(std::span<const double> energy, double bin_s, double direct_energy, double snr_db) {
  double total = direct_energy;
  for (const double value : energy) total += value;
  if (!(total > 0) || !std::isfinite(total)) return std::nullopt;
  const double heard = 1.0 / (1.0 + std::pow(10.0, -0.1 * snr_db));
  double sum = 0;
  for (const double modulation_hz : kModulationHz) {
    const double m = heard * modulation_transfer(energy, bin_s, direct_energy, modulation_hz);
    const double apparent_db = m < 1.0 ? 10.0 * std::log10(std::max(m, 1e-30) / (1.0 - m)) : 15.0;
    sum += (std::clamp(apparent_db, -15.0, 15.0) + 15.0) / 30.0;
  }
  return sum / kModulationHz.size();
}

std::optional<std::array<std::size_t, kSpeechOctaves>> speech_octaves(std::span<const float> bands_hz) {
  // 0.3 of an octave either side: the centre of a clipped band may lie lower.
  std::array<std::size_t, kSpeechOctaves> found{};
  for (std::size_t k = 0; k < kSpeechOctaves; ++k) {
    const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (static_cast<double>(k) - 3.0));
    std::size_t matches = 0;
    for (std::size_t band = 0; band < bands_hz.size(); ++band) {
      if (std::abs(std::log2(static_cast<double>(bands_hz[band]) / centre_hz)) > 0.3) continue;
      found[k] = band;
      ++matches;
    }
    if (matches != 1) return std::nullopt;
    if (k > 0 && found[k] != found[k - 1] + 1) return std::nullopt;
  }
  return found;
}

double speech_transmission_index(std::span<const double, kSpeechOctaves> mti) {
  constexpr std::array<double, 7> weight{0.085, 0.127, 0.230, 0.233, 0.309, 0.224, 0.173};
  constexpr std::array<double, 6> redundancy{0.085, 0.078, 0.065, 0.011, 0.047, 0.095};
  double sti = 0;
  for (std::size_t k = 0; k < 7; ++k) sti += weight[k] * mti[k];
  for (std::size_t k = 0; k < 6; ++k) sti -= redundancy[k] * std::sqrt(mti[k] * mti[k + 1]);
  return std::clamp(sti, 0.0, 1.0);
}

}  // namespace earshot
