// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <span>
#include <vector>

#include "sim/audio/transforms/fft.h"

namespace earshot {

/// Phase of the response of least delay that has given magnitudes: the Hilbert transform of their logarithm, by the folded cepstrum
/// (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., section 13.5).  Owns scratch: one per thread.
class MinimumPhase {
 public:
  /// size: of the transform, a power of two; magnitudes of size / 2 + 1 bins.  Its cepstrum must die out within size / 2 samples.
  explicit MinimumPhase(int size);
  [[nodiscard]] std::size_t num_bins() const { return spectrum_.size(); }
  /// log_magnitude: natural logarithm, [num_bins], finite.  phase_rad: [num_bins], for the time factor exp(+i w t).
  void operator()(std::span<const float> log_magnitude, std::span<float> phase_rad);

 private:
  RealFft fft_;
  std::vector<std::complex<float>> spectrum_;
  std::vector<float> cepstrum_;
};

}  // namespace earshot
