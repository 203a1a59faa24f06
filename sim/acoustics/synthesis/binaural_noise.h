// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/audio/head/hrtf.h"

namespace earshot {

/// A late field as two ears hear it, made beforehand: for each band a pair of noises, with the covariance of the ears in a diffuse field
/// (that of Hrtf::diffuse_decoder on four independent carriers), split into the noise of the left ear and the part of the right ear that is
/// uncorrelated with it.
/// A real 2 x 2 matrix on them gives the power at each ear and the correlation between them that the decoder gives to a field with a mean
/// direction, in every band as a whole.  What it does not give is the time between the ears: within a band the spectrum, and over lag the
/// correlation, keep the shapes that they have in a diffuse field.
/// Immutable.  The noise turns with the head.
class BinauralNoise {
 public:
  BinauralNoise() = default;
  /// carriers: their first four channels.  Takes about 10 ms for each kind of half a second at 16 kHz, and the memory of those carriers.
  BinauralNoise(const CarrierBank& carriers, const BandLayout& bands, const Hrtf& hrtf);

  /// part 0: the left ear; 1: the part of the right ear that is uncorrelated with part 0.  kind: of the carriers; all have the same
  /// powers.
  [[nodiscard]] std::span<const float> loop(int band, int part, int kind = 0) const {
    const std::size_t row = (static_cast<std::size_t>(kind) * bands_.size() + static_cast<std::size_t>(band)) * 2;
    return std::span(samples_).subspan((row + static_cast<std::size_t>(part)) * (length_ + CarrierBank::kPad), length_);
  }

  /// left ear = left * part 0; right ear = shared * part 0 + own * part 1.
  struct Mix {
    float left = 1, shared = 0, own = 1;
  };
  /// Of a field of unit density.  m: N3D channels 1 to 3 over channel 0, head axes, |m|^2 <= 3.
  [[nodiscard]] Mix mix(int band, const std::array<float, 3>& m) const;

 private:
  /// constant + linear . m + m . (square m): covariance over density.
  struct Form {
    std::array<float, 10> c{};  ///< 1; m1, m2, m3; m1 m1, m2 m2, m3 m3; m1 m2, m1 m3, m2 m3
    [[nodiscard]] float at(const std::array<float, 10>& products) const {
      float sum = 0;
      for (std::size_t i = 0; i < c.size(); ++i) sum += c[i] * products[i];
      return sum;
    }
  };
  /// Filters [channel * 2 + ear] on the bins of a loop.
  using Decoder = std::array<std::vector<std::complex<float>>, 8>;
  void find_covariances(int band, const BandFilters& filters, const Decoder& decoder);
  void make_noise(int band, int kind, const CarrierBank& carriers, const Decoder& decoder);

  struct Band {
    Form left, right, cross;
    float one_over_left = 0, one_over_own = 0;  ///< of the powers of parts 0 and 1
  };

  std::size_t length_ = 0;
  std::vector<float> samples_;  ///< [kind][band][part][length + CarrierBank::kPad]
  std::vector<Band> bands_;
};

}  // namespace earshot
