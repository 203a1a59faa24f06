// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <limits>
#include <span>
#include <vector>

namespace earshot {

/// Near-field correction of a head: the pressure on a rigid sphere from a point source over that from the
/// distance at which a head was measured (Duda and Martens 1998, eqs. 1 and 6), per bin, with magnitude and phase.  It depends on the
/// distance and on the angle between source and ear alone, and so corrects any head.
/// kFarFieldM on it is 1, and continuous in distance, angle and frequency; nearer than kNearestM it stays what it is there.
/// Immutable.  Making it takes about 0.1 s at 16 kHz.
class NearHead {
 public:
  /// A source at 3 m still has 0.4 dB more at the near ear and 0.4 dB less at the far one than one at infinity; this much is left out
  /// there.
  static constexpr double kNearestM = 0.125, kFarFieldM = 3.0;

  /// measured_m: distance at which the head was measured; infinite for a computed one, and where it is not known.
  NearHead(float sample_rate_hz, int fft_size, double measured_m = std::numeric_limits<double>::infinity());

  [[nodiscard]] static bool applies(double distance_m) { return distance_m < kFarFieldM; }
  /// Multiplies the spectrum of an ear, [fft_size / 2 + 1], but for the delay, in samples, which it returns.  angle_rad: between the
  /// directions of source and ear, from the head's centre. distance_m: from the head's centre, >= 0.  Does nothing where it does not apply.
  /// About 1 us at 16 kHz.
  double apply(double distance_m, double angle_rad, std::span<std::complex<float>> spectrum) const;

 private:
  [[nodiscard]] std::span<const std::complex<float>> row(std::size_t distance, std::size_t angle) const;

  std::size_t num_bins_;
  double rate_hz_, measured_m_;
  std::vector<double> distance_m_;          ///< rising
  std::vector<std::complex<float>> ratio_;  ///< [distance][angle][bin], with the first wave front at time zero
};

}  // namespace earshot
