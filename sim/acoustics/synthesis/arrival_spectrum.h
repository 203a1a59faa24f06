// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/band_filters.h"

namespace earshot {

/// Spectrum of an arrival from its bands, per bin: gains with raised-cosine crossovers, and phases that go straight from one band centre's
/// region to the next by the shorter way.  Phases of a multiple of pi are signs.  Owns scratch; no allocation after construction.
class ArrivalSpectrum {
 public:
  explicit ArrivalSpectrum(const BandFilters& filters);
  /// amplitude, phase_rad: [num_bands], at the centres.
  void set(std::span<const float> amplitude, std::span<const float> phase_rad);
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
  std::array<float, kMaxBands> signed_{}, way_{};
  std::array<std::complex<float>, kMaxBands> turn_{};
  std::vector<Run> runs_;
  std::vector<float> gain_;
  std::vector<std::complex<float>> factor_;
  bool silent_ = true, flat_ = true, real_ = true;
};

}  // namespace earshot
