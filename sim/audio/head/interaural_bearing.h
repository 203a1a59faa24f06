// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <span>
#include <vector>

#include "sim/audio/transforms/fft.h"

namespace earshot {

/// Lateral angle of a sound from the differences of phase and level between two ears: the steered response with phase
/// transform (DiBiase 2000, section 6.3; for two microphones GCC-PHAT of Knapp and Carter 1976), steered over lateral angles by the
/// diffraction of a plane wave at a rigid sphere (Duda and Martens 1998), so that low sounds, which go around a head half as late again as
/// high ones,
/// are judged rightly.  Lateral angles are on the horizontal plane, in radians, positive to the left; what is in front and what is behind
/// at the same lateral angle sounds alike.  Owns an FFT and scratch: one per thread.
class InterauralBearing {
 public:
  static constexpr int kNumAngles = 37;  ///< from -90 to 90 degrees, 5 apart
  static double angle_rad(int i);

  explicit InterauralBearing(float sample_rate_hz);  ///< takes about 30 ms

  struct Estimate {
    double lateral_rad = 0;  ///< where the response is largest, between the angles
    double agreement = 0;    ///< that response, in [-1, 1]: near 1 where nearly all of the sound comes straight from there
    double coherence = 0;    ///< between the ears in [0, 1], averaged over bins that hold sound: falls with reverberation
    bool silent = true;      ///< nothing to judge by: all is zero
  };
  /// sound [2, num_samples], left ear first, at least 512 samples each.  response [kNumAngles]: for each angle the agreement of the ears
  /// with it.  About 0.1 ms for 2,400 samples.
  Estimate estimate(std::span<const float> sound, std::span<float> response);

 private:
  /// Sums over the bins that hold sound.
  struct BinSums {
    double weights = 0, coherences = 0;
    std::size_t num_bins = 0;
  };
  void add_frames(std::span<const float> sound);
  [[nodiscard]] float loudest_power() const;
  BinSums steer(float least_power, std::span<float> response) const;

  RealFft fft_;
  std::size_t first_bin_, num_bins_;
  std::vector<float> window_, frame_;
  std::vector<std::complex<float>> left_, right_, cross_;
  std::vector<float> power_left_, power_right_;
  std::vector<std::complex<float>> steer_;  ///< [kNumAngles][num_bins_] of unit length: the phase of left over right
  std::vector<float> level_db_;             ///< [kNumAngles][num_bins_] left over right
};

}  // namespace earshot
