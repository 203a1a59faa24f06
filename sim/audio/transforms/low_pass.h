// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <span>

namespace earshot {

/// Low-pass of fourth order without ripple (Butterworth; two biquads by the bilinear transform, Smith 2007, "Introduction to Digital
/// Filters", appendix I): -3 dB at the cutoff, 24 dB per octave above it.  Causal, gain 1 at 0 Hz.  A plain value.
class LowPass {
 public:
  /// cutoff_hz: in (0, sample_rate_hz / 2).
  LowPass(double cutoff_hz, double sample_rate_hz);

  /// Filters a whole signal in place; silence comes before it.
  void filter(std::span<float> samples) const;
  /// Its response at this frequency.
  [[nodiscard]] std::complex<double> response(double frequency_hz) const;
  /// Samples after which what it rings is below -80 dB.
  [[nodiscard]] double ring_samples() const { return ring_samples_; }

 private:
  struct Biquad {
    double b0, b1, b2, a1, a2;
  };
  double rate_hz_, ring_samples_;
  std::array<Biquad, 2> sections_;
};

}  // namespace earshot
