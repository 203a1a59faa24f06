// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Shape of the weights of bands over frequency.
enum class BandShape {
  crossover,  ///< flat, with raised-cosine edges in log frequency, half an octave wide or as wide as the narrower band: for noise
  line        ///< straight from centre to centre in log frequency, without steps: for spectra of which the values at the centres are known
};

/// Zero-phase band filters on the bins of an FFT.  The lowest band reaches down to 0 Hz and the highest up to half the rate.  The weights
/// F_b of all bands sum to 1 in every bin: as amplitudes they leave an impulse an impulse, as powers (amplitude sqrt F_b) they leave the
/// sum of independent noises white (docs/evidence/oracles.md, O-31).
class BandFilters {
 public:
  BandFilters(const BandLayout& bands, float sample_rate_hz, int fft_size, BandShape shape = BandShape::crossover);

  [[nodiscard]] int num_bands() const { return num_bands_; }
  [[nodiscard]] std::size_t num_bins() const { return lower_.size(); }
  [[nodiscard]] double bin_hz() const { return bin_hz_; }
  /// F_b in bin k, in [0, 1].
  [[nodiscard]] float weight(int band, std::size_t bin) const;
  /// Spectrum gain[k] = sum over b of F_b(k) value[b].  Equal values give exactly that value in every bin.
  void blend(std::span<const float> value, std::span<float> gain) const;
  /// Per bin: the lower of the at most two bands that overlap there, and the weight of the band above it.
  [[nodiscard]] std::span<const std::uint8_t> lower_bands() const { return lower_; }
  [[nodiscard]] std::span<const float> upper_weights() const { return upper_weight_; }

 private:
  void set_crossover(std::size_t bin, const BandLayout& bands);
  void set_line(std::size_t bin, const BandLayout& bands);

  int num_bands_;
  double bin_hz_;
  std::vector<std::uint8_t> lower_;  ///< per bin: the lower of the at most two bands that overlap there
  std::vector<float> upper_weight_;  ///< per bin: weight of the band above `lower_`
};

}  // namespace earshot
