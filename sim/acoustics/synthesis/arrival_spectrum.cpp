// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/arrival_spectrum.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "sim/acoustics/paths/band_lanes.h"
#include "sim/audio/transforms/spectrum_math.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
/// Phases this close to a multiple of pi are signs.
constexpr double kSignRad = 1e-5;

/// Loss of pressure that is undone at most: sound that has lost more, 347 dB, is silent either way.
constexpr double kMostNepers = 40;

using Complex = std::complex<float>;

/// exp(i angle) for |angle| <= pi within 3e-7: series at a quarter of the angle, squared twice.
Complex unit_turn(float angle) {
  const float x = 0.25f * angle, y = x * x;
  const Complex quarter(1.f + y * (-1.f / 2 + y * (1.f / 24 + y * (-1.f / 720 + y * (1.f / 40320)))),
                        x * (1.f + y * (-1.f / 6 + y * (1.f / 120 + y * (-1.f / 5040 + y * (1.f / 362880))))));
  const Complex half = multiply(quarter, quarter);
  return multiply(half, half);
}

}  // namespace

ArrivalSpectrum::ArrivalSpectrum(const BandFilters& filters) : filters_(filters), factor_(filters.num_bins()) {
  gain_.resize((filters.num_bins() + kLanes - 1) / kLanes * kLanes);
  air_nepers_per_m_.resize(gain_.size());
  const std::span<const std::uint8_t> lower = filters_.lower_bands();
  for (std::size_t k = 0; k < factor_.size(); ++k) {
    const bool turns = filters_.upper_weights()[k] != 0.f;
    if (runs_.empty() || runs_.back().lower != lower[k] || runs_.back().turns != turns) runs_.push_back({k, k, lower[k], turns});
    runs_.back().end = k + 1;
  }
}

void ArrivalSpectrum::set_air(const AirLoss& air) {
  if (air == air_) return;
  air_ = air;
  has_air_ = air.curve != AirCurve{};
  const double nepers_per_db = std::numbers::ln10 / 20.0;
  for (std::size_t k = 0; k < filters_.num_bins(); ++k)
    air_nepers_per_m_[k] = static_cast<float>(nepers_per_db * air.curve.db_per_m(static_cast<double>(k) * filters_.bin_hz()));
}

/// Multiplies the gains by what the air leaves of each bin.
void ArrivalSpectrum::take_air(double distance_m) {
  if (!has_air_) return;
  const auto minus_m = static_cast<float>(-distance_m);
  for (std::size_t k = 0; k < gain_.size(); k += kLanes) {
    Lanes gain, nepers_per_m;
    std::memcpy(&gain, &gain_[k], sizeof gain);
    std::memcpy(&nepers_per_m, &air_nepers_per_m_[k], sizeof nepers_per_m);
    gain *= exp_of_negative(nepers_per_m * minus_m);
    std::memcpy(&gain_[k], &gain, sizeof gain);
  }
}

void ArrivalSpectrum::set(std::span<const float> amplitude, std::span<const float> phase_rad, double distance_m) {
  const auto bands = static_cast<std::size_t>(filters_.num_bands());
  silent_ = std::all_of(amplitude.begin(), amplitude.end(), [](float value) { return value == 0.f; });
  real_ = true;
  for (std::size_t b = 0; b < bands; ++b) {
    const double lost = has_air_ ? 0.5 * static_cast<double>(air_.band_per_m[b]) * distance_m : 0.0;
    before_air_[b] = lost > 0 ? amplitude[b] * static_cast<float>(std::exp(std::min(lost, kMostNepers))) : amplitude[b];
    const double phase = static_cast<double>(phase_rad[b]), halves = std::round(phase / kPi);
    real_ = real_ && std::abs(phase - halves * kPi) < kSignRad;
    signed_[b] = std::fmod(std::abs(halves), 2.0) == 1.0 ? -before_air_[b] : before_air_[b];
  }
  flat_ = real_ && !has_air_ &&
          std::all_of(signed_.begin(), signed_.begin() + static_cast<std::ptrdiff_t>(bands), [&](float v) { return v == signed_[0]; });
  if (silent_ || flat_) return;
  filters_.blend(std::span(real_ ? signed_ : before_air_).first(bands), gain_);
  take_air(distance_m);
  if (real_) return;
  // From one band to the next by the shorter way; between their regions the phase follows the upper weight.
  for (std::size_t b = 0; b < bands; ++b) {
    turn_[b] = Complex(std::polar(1.0, static_cast<double>(phase_rad[b])));
    const double way =
        b + 1 < bands ? std::remainder(static_cast<double>(phase_rad[b + 1]) - static_cast<double>(phase_rad[b]), 2.0 * kPi) : 0.0;
    way_[b] = static_cast<float>(way);
  }
  const float *weight = filters_.upper_weights().data(), *gain = gain_.data();
  Complex* factor = factor_.data();
  for (const Run& run : runs_) {
    const Complex turn = turn_[run.lower];
    const float way = way_[run.lower];
    if (run.turns) {
      for (std::size_t k = run.begin; k < run.end; ++k) factor[k] = gain[k] * multiply(turn, unit_turn(weight[k] * way));
    } else {
      for (std::size_t k = run.begin; k < run.end; ++k) factor[k] = gain[k] * turn;
    }
  }
}

void ArrivalSpectrum::apply(std::span<std::complex<float>> spectrum) const {
  std::complex<float>* values = spectrum.data();
  if (flat_) {
    const float factor = signed_[0];
    for (std::size_t k = 0; k < spectrum.size(); ++k) values[k] *= factor;
  } else if (real_) {
    const float* gain = gain_.data();
    for (std::size_t k = 0; k < spectrum.size(); ++k) values[k] *= gain[k];
  } else {
    for (std::size_t k = 0; k < spectrum.size(); ++k)
      values[k] = {values[k].real() * factor_[k].real() - values[k].imag() * factor_[k].imag(),
                   values[k].real() * factor_[k].imag() + values[k].imag() * factor_[k].real()};
  }
}

}  // namespace earshot
