// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "sim/audio/measured/minimum_phase.h"

namespace earshot {

/// A response of an ear taken apart into what may be interpolated between directions: magnitudes, a delay, and what the phase has beyond
/// the least one of these magnitudes and this delay.
struct ResponseParts {
  std::vector<float> log_magnitude;         ///< [num_bins], natural logarithm
  std::vector<std::complex<float>> excess;  ///< [num_low_bins], of magnitude one
  double delay_s = 0;                       ///< of the response behind the one of least phase

  /// The sum of parts with weights.
  void add(const ResponseParts& other, float weight);
};

/// Takes responses of one rate apart on the frequencies of another, and puts them together.  Owns scratch: one per thread.
class ResponseDivider {
 public:
  /// bin_hz: distance of the bins.  band_hz: up to where magnitudes count; not beyond half the rate of the responses.
  ResponseDivider(std::size_t num_taps, double response_rate_hz, double bin_hz, double band_hz);
  [[nodiscard]] std::size_t num_bins() const { return num_bins_; }
  [[nodiscard]] ResponseParts empty() const;

  /// The delay is that of the largest cross-correlation with the response of least phase, below 3 kHz: there it changes smoothly with the
  /// direction, where the first rise above a threshold jumps (Nam et al. 2008).
  ResponseParts divide(std::span<const float> response);
  /// Spectrum without the delay; zero beyond num_bins.  The excess phase counts below 1.5 kHz, where ears tell phases apart, and not above
  /// 3 kHz, where it is noise of the measurement.
  void join(const ResponseParts& parts, std::span<std::complex<float>> spectrum);

 private:
  void write_spectrum(std::span<const float> response);
  void write_phase(std::span<const float> log_magnitude);
  double find_delay(std::span<const float> log_magnitude);

  std::size_t num_bins_, num_low_bins_;
  double bin_hz_;
  std::vector<float> cosine_, sine_;  ///< [tap][bin]
  std::vector<float> real_, imaginary_;
  MinimumPhase minimum_phase_;
  RealFft fft_;
  std::vector<float> held_log_, phase_, correlation_;  ///< of the size of the transform
  std::vector<std::complex<float>> correlation_spectrum_;
};

}  // namespace earshot
