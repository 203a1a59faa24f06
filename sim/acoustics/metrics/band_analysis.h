// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/audio/transforms/fft.h"

namespace earshot {

inline constexpr double kMeasuredBinS = 1e-3;

/// A response in one band: energies in bins of kMeasuredBinS from time zero on, what lies before it in the first.  Every band reads in
/// Green units.
struct BandSignals {
  double direct_energy = 0;
  std::vector<double> after_direct;      ///< of what is not direct sound; empty for a band without frequencies
  std::vector<double> whole;             ///< of the whole response
  std::vector<double> lateral, product;  ///< of the figure-of-eight response, and of the size of its product with the other one
};

/// Filters a response band by band, direct sound and rest apart, so that the ringing of the direct sound does not count as reverberation.
class BandAnalysis {
 public:
  /// lateral: empty, or as long as `rir`.  half_width: of the filters' edges (octave_filter.h).  delay_s: time zero, of the direct sound.
  /// has_direct: false counts all of it as reverberation.
  BandAnalysis(std::span<const float> rir, std::span<const float> lateral, const BandLayout& bands, double half_width, double rate,
               double delay_s, bool has_direct = true);
  BandSignals filter_band(int band);
  /// Of all frequencies.
  [[nodiscard]] double direct_energy() const { return direct_energy_; }
  [[nodiscard]] double rest_energy() const { return rest_energy_; }

 private:
  using Spectrum = std::vector<std::complex<float>>;
  double set_gain(int band);
  std::vector<float> filtered(const Spectrum& spectrum);
  template <class Energy>
  [[nodiscard]] std::vector<double> series_of(const Energy& energy, double delta_energy) const;

  const BandLayout& bands_;
  double half_width_, rate_, start_, direct_energy_ = 0, rest_energy_ = 0;
  std::size_t num_bins_;
  RealFft fft_;
  Spectrum direct_spectrum_, rest_spectrum_, lateral_spectrum_, filtered_;
  std::vector<float> gain_;
};

}  // namespace earshot
