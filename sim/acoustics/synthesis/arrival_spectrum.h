// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/core/air_loss.h"
#include "sim/acoustics/synthesis/band_filters.h"

namespace earshot {

/// Spectrum of an arrival from its bands, per bin.  Air takes from each bin what it takes at that frequency.  All else has the values of
/// the bands at their centres; between these gains and phases follow the weights of the filters, phases by the shorter way.  Phases of a
/// multiple of pi are signs.  Owns scratch; no allocation after construction.
class ArrivalSpectrum {
 public:
  explicit ArrivalSpectrum(const BandFilters& filters);
  /// Air of the arrivals that follow; none at first.  Of other air than before: 1 ns per bin.
  void set_air(const AirLoss& air);
  /// amplitude, phase_rad: [num_bands], at the centres, with the loss of the air over distance_m.
  void set(std::span<const float> amplitude, std::span<const float> phase_rad, double distance_m);
  [[nodiscard]] bool silent() const { return silent_; }
  /// The same real factor in all bands?
  [[nodiscard]] bool flat() const { return flat_; }
  /// That factor.
  [[nodiscard]] float factor() const { return signed_[0]; }
  /// Multiplies a spectrum [num_bins] by it.
  void apply(std::span<std::complex<float>> spectrum) const;

 private:
  /// Bins between the same two bands: all in the region of the lower one, or all on the way.
  struct Run {
    std::size_t begin, end;
    std::uint8_t lower;
    bool turns;
  };
  const BandFilters& filters_;
  void take_air(double distance_m);

  AirLoss air_;
  bool has_air_ = false;
  std::vector<float> air_nepers_per_m_;  ///< of pressure, per bin; a multiple of eight bins
  std::array<float, kMaxBands> before_air_{}, signed_{}, way_{};
  std::array<std::complex<float>, kMaxBands> turn_{};
  std::vector<Run> runs_;
  std::vector<float> gain_;
  std::vector<std::complex<float>> factor_;
  bool silent_ = true, flat_ = true, real_ = true;
};

}  // namespace earshot
