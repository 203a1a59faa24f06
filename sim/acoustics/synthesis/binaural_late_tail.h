// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/binaural_noise.h"
#include "sim/acoustics/synthesis/late_carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"
#include "sim/audio/head/harmonic_rotation.h"
#include "sim/audio/head/listener_orientation.h"

namespace earshot {

/// The end of the late field at two ears, straight from noise that was decoded beforehand (BinauralNoise): in every bin and band the power
/// at each ear and the correlation between them are those of the field's first-order moments through the head's decoder.  A tenth of the
/// time of four channels and their transforms.  Owns scratch: one per thread; no allocation once warm.
///
/// Between the middles of two bins amplitudes change linearly, from silence and to it powers do.  That is (a - b)^2 / 6 less than the mean
/// of two powers a^2 and b^2: 0.04 dB in a decay of 60 dB in 0.5 s over bins of 16 ms, half of what their chord lies above the
/// exponential.  Where the correlation changes by an angle of cosine, the right ear loses a sixth of its square: below 0.1 dB up to 0.3.
class BinauralLateTail {
 public:
  /// Adds bins from first_bin on to both ears (equal lengths, at least those of the envelope); from the middle of the bin before it the
  /// sound grows as linearly in power as that of LateSynthesizer, with its end there, falls.  place: set for
  /// the envelope, with a stream of its own.
  void add(const LateEnvelope& envelope, int first_bin, const BinauralNoise& noise, LateCarriers& place,
           const ListenerOrientation& orientation, std::span<float> left, std::span<float> right);

 private:
  void make_mixes(const LateEnvelope& envelope, int first_bin, const BinauralNoise& noise, const ListenerOrientation& orientation);

  HarmonicRotation rotation_{1};
  std::vector<BinauralNoise::Mix> mixes_;  ///< [band][bin], times the amplitude there; of bins with sound
};

}  // namespace earshot
