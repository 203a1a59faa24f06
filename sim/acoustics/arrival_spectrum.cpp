#include "sim/acoustics/arrival_spectrum.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
/// Phases this close to a multiple of pi are signs.
constexpr double kSignRad = 1e-5;

}  // namespace

ArrivalSpectrum::ArrivalSpectrum(const BandFilters& filters)
    : filters_(filters), gain_(filters.num_bins()), turn_(filters.num_bins()), factor_(filters.num_bins()) {}

void ArrivalSpectrum::set(std::span<const float> amplitude, std::span<const float> phase_rad) {
  const auto bands = static_cast<std::size_t>(filters_.num_bands());
  silent_ = std::all_of(amplitude.begin(), amplitude.end(), [](float value) { return value == 0.f; });
  real_ = true;
  for (std::size_t b = 0; b < bands; ++b) {
    const double phase = static_cast<double>(phase_rad[b]), halves = std::round(phase / kPi);
    real_ = real_ && std::abs(phase - halves * kPi) < kSignRad;
    signed_[b] = std::fmod(std::abs(halves), 2.0) == 1.0 ? -amplitude[b] : amplitude[b];
  }
  flat_ =
      real_ && std::all_of(signed_.begin(), signed_.begin() + static_cast<std::ptrdiff_t>(bands), [&](float v) { return v == signed_[0]; });
  if (silent_ || flat_) return;
  if (real_) {
    filters_.blend(std::span(signed_).first(bands), gain_);
    return;
  }
  phase_[0] = phase_rad[0];
  for (std::size_t b = 1; b < bands; ++b)
    phase_[b] = phase_[b - 1] +
                static_cast<float>(std::remainder(static_cast<double>(phase_rad[b]) - static_cast<double>(phase_[b - 1]), 2.0 * kPi));
  filters_.blend(amplitude, gain_);
  filters_.blend(std::span(phase_).first(bands), turn_);
  for (std::size_t k = 0; k < factor_.size(); ++k) factor_[k] = std::polar(gain_[k], turn_[k]);
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
