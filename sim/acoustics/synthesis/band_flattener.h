// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/audio/transforms/fft.h"

namespace earshot {

/// Makes one band of a few channels of noise flat and locally independent.  Works on as few samples as the band needs.  Owns its scratch.
///
/// Two steps.  The local covariance of all channels, over a window wide enough to hold as many independent samples as there are channels,
/// is made the identity: every mixture of the channels, as an ear makes one, is then flat.  After that each channel alone is flattened over
/// a narrower window.
class BandFlattener {
 public:
  static constexpr std::size_t kMaxChannels = 4;
  /// length: samples of the noise, a power of two, at the FFT size of the filters.
  BandFlattener(std::size_t num_channels, int length, const BandFilters& filters, int band);

  /// noise: spectra [num_channels][length / 2 + 1] of white noise of unit variance.
  void flatten(std::span<const std::vector<std::complex<float>>> noise);
  /// Adds the flat band of a channel to its spectrum [length / 2 + 1].
  void add_to(std::size_t channel, std::span<std::complex<float>> spectrum) const;

 private:
  template <class T>
  using PerChannel = std::array<T, kMaxChannels>;

  void cut_band(std::span<const std::complex<float>> spectrum, std::span<std::complex<float>> signal);
  void smooth(std::span<float> values, std::span<const float> window);
  void measure_covariance();
  void whiten(std::size_t sample);

  std::size_t num_channels_, length_;
  RealFft fft_;
  float scale_;                ///< to the power of the band at the length of the noise
  std::vector<float> weight_;  ///< of the band, per bin
  std::vector<float> wide_, narrow_;
  std::vector<float> plane_;
  std::vector<std::complex<float>> bins_;
  PerChannel<std::vector<std::complex<float>>> signal_;  ///< analytic
  PerChannel<PerChannel<std::vector<float>>> covariance_;
};

}  // namespace earshot
