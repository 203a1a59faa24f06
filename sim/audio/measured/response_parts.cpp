// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/response_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

/// Where delays are looked for, and where the excess phase counts: whole below the first, not at all above the second.
constexpr double kWholeHz = 1500, kTopHz = 3000;
/// Notches are no deeper than this below the largest magnitude: their logarithm has no lower end.
constexpr float kFloor = 1e-3f;

float fade(double frequency_hz) { return static_cast<float>(std::clamp((kTopHz - frequency_hz) / (kTopHz - kWholeHz), 0.0, 1.0)); }

std::size_t count_bins(double top_hz, double bin_hz) { return static_cast<std::size_t>(std::floor(top_hz / bin_hz + 1e-9)) + 1; }

int transform_size(std::size_t num_bins) { return std::max(64, next_power_of_two(2 * (static_cast<int>(num_bins) - 1))); }

}  // namespace

void ResponseParts::add(const ResponseParts& other, float weight) {
  for (std::size_t k = 0; k < log_magnitude.size(); ++k) log_magnitude[k] += weight * other.log_magnitude[k];
  for (std::size_t k = 0; k < excess.size(); ++k) excess[k] += weight * other.excess[k];
  delay_s += static_cast<double>(weight) * other.delay_s;
}

ResponseDivider::ResponseDivider(std::size_t num_taps, double response_rate_hz, double bin_hz, double band_hz)
    : num_bins_(count_bins(std::min(band_hz, 0.5 * response_rate_hz), bin_hz)),
      num_low_bins_(std::min(num_bins_, count_bins(kTopHz, bin_hz))),
      bin_hz_(bin_hz),
      cosine_(num_taps * num_bins_),
      sine_(num_taps * num_bins_),
      real_(num_bins_),
      imaginary_(num_bins_),
      minimum_phase_(transform_size(num_bins_)),
      fft_(transform_size(num_bins_)),
      held_log_(minimum_phase_.num_bins()),
      phase_(minimum_phase_.num_bins()),
      correlation_(static_cast<std::size_t>(fft_.size())),
      correlation_spectrum_(minimum_phase_.num_bins()) {
  for (std::size_t n = 0; n < num_taps; ++n) {
    for (std::size_t k = 0; k < num_bins_; ++k) {
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(k) * bin_hz / response_rate_hz * static_cast<double>(n);
      cosine_[n * num_bins_ + k] = static_cast<float>(std::cos(angle));
      sine_[n * num_bins_ + k] = static_cast<float>(std::sin(angle));
    }
  }
}

ResponseParts ResponseDivider::empty() const {
  return {.log_magnitude = std::vector<float>(num_bins_), .excess = std::vector<std::complex<float>>(num_low_bins_)};
}

/// Exact resampling, as the transform of a finite response is known at every frequency.
void ResponseDivider::write_spectrum(std::span<const float> response) {
  std::ranges::fill(real_, 0.f);
  std::ranges::fill(imaginary_, 0.f);
  for (std::size_t n = 0; n < response.size(); ++n) {
    const float value = response[n];
    const float *cosine = cosine_.data() + n * num_bins_, *sine = sine_.data() + n * num_bins_;
    for (std::size_t k = 0; k < num_bins_; ++k) real_[k] += value * cosine[k];
    for (std::size_t k = 0; k < num_bins_; ++k) imaginary_[k] -= value * sine[k];
  }
}

/// Least phase; beyond the band the last magnitude goes on.
void ResponseDivider::write_phase(std::span<const float> log_magnitude) {
  std::ranges::copy(log_magnitude, held_log_.begin());
  std::fill(held_log_.begin() + static_cast<std::ptrdiff_t>(num_bins_), held_log_.end(), log_magnitude.back());
  minimum_phase_(held_log_, phase_);
}

double ResponseDivider::find_delay(std::span<const float> log_magnitude) {
  std::ranges::fill(correlation_spectrum_, std::complex<float>());
  for (std::size_t k = 1; k < num_low_bins_; ++k)
    correlation_spectrum_[k] = fade(static_cast<double>(k) * bin_hz_) * std::exp(log_magnitude[k]) *
                               std::complex<float>(real_[k], imaginary_[k]) * std::polar(1.f, -phase_[k]);
  fft_.inverse(correlation_spectrum_, correlation_);
  const auto size = static_cast<double>(correlation_.size());
  auto at = static_cast<double>(std::ranges::max_element(correlation_) - correlation_.begin());
  if (at > 0.875 * size) at -= size;
  // The peak between samples: Newton's method on the sum itself.
  const double step = 2.0 * std::numbers::pi / size;
  for (int i = 0; i < 3; ++i) {
    double slope = 0, curvature = 0;
    for (std::size_t k = 1; k < num_low_bins_; ++k) {
      const double omega = step * static_cast<double>(k);
      const std::complex<double> term = std::complex<double>(correlation_spectrum_[k]) * std::polar(1.0, omega * at);
      slope -= omega * term.imag();
      curvature -= omega * omega * term.real();
    }
    if (curvature < 0) at -= std::clamp(slope / curvature, -1.0, 1.0);
  }
  return at / (size * bin_hz_);
}

ResponseParts ResponseDivider::divide(std::span<const float> response) {
  write_spectrum(response);
  ResponseParts parts = empty();
  float largest = 0;
  for (std::size_t k = 0; k < num_bins_; ++k) largest = std::max(largest, std::hypot(real_[k], imaginary_[k]));
  const float floor = std::max(kFloor * largest, 1e-30f);
  for (std::size_t k = 0; k < num_bins_; ++k) parts.log_magnitude[k] = std::log(std::max(std::hypot(real_[k], imaginary_[k]), floor));
  write_phase(parts.log_magnitude);
  parts.delay_s = find_delay(parts.log_magnitude);
  for (std::size_t k = 0; k < num_low_bins_; ++k) {
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) * bin_hz_ * parts.delay_s - static_cast<double>(phase_[k]);
    const std::complex<float> value = std::complex<float>(real_[k], imaginary_[k]) * std::complex<float>(std::polar(1.0, turn));
    const float magnitude = std::abs(value);
    parts.excess[k] = magnitude > 0 ? value / magnitude : std::complex<float>(1.f);
  }
  return parts;
}

void ResponseDivider::join(const ResponseParts& parts, std::span<std::complex<float>> spectrum) {
  write_phase(parts.log_magnitude);
  std::ranges::fill(spectrum, std::complex<float>());
  for (std::size_t k = 0; k < std::min(num_bins_, spectrum.size()); ++k) {
    float phase = phase_[k];
    if (k < num_low_bins_) phase += fade(static_cast<double>(k) * bin_hz_) * std::arg(parts.excess[k]);
    spectrum[k] = std::polar(std::exp(parts.log_magnitude[k]), phase);
  }
}

}  // namespace earshot
