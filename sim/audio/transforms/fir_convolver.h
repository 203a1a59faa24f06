// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <optional>
#include <span>
#include <vector>

#include "sim/audio/transforms/fft.h"

namespace earshot {

/// Convolution of a signal with the filters of several channels, by overlap-add (Stockham 1966) with transforms of two to four times the
/// length of a filter.  Rounding: 1e-6 of the peak.  Owns scratch: one per thread.
class FirConvolver {
 public:
  /// filters: [num_channels, taps], taps at least 1.  Returns [num_channels, signal.size() + taps - 1]; empty for an empty signal.
  /// About 4 ms per channel and second of sound at 16 kHz and a filter of one second.
  std::vector<float> convolve(std::span<const float> signal, std::span<const float> filters, int num_channels);

 private:
  std::optional<RealFft> fft_;  ///< of the last length of filters
  std::vector<std::complex<float>> filter_spectra_, spectrum_, product_;
  std::vector<float> time_;
};

}  // namespace earshot
