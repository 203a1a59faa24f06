#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/binaural_noise.h"
#include "sim/acoustics/synthesis/late_envelope.h"
#include "sim/audio/harmonic_rotation.h"
#include "sim/audio/listener_orientation.h"

namespace earshot {

/// The end of the late field at two ears, straight from noise that was decoded beforehand (EarNoise): in every slot and band the power at
/// each ear and the correlation between them are those of the field's first-order moments through the head's decoder.  A tenth of the time
/// of four channels and their transforms.  Owns scratch: one per thread; no allocation once warm.
///
/// Between the middles of two slots amplitudes change linearly, from silence and to it powers do.  That is (a - b)^2 / 6 less than the mean
/// of two powers a^2 and b^2: 0.04 dB in a decay of 60 dB in 0.5 s over slots of 16 ms, half of what their chord lies above the
/// exponential.  Where the correlation changes by an angle of cosine, the right ear loses a sixth of its square: below 0.1 dB up to 0.3.
class LateEars {
 public:
  /// Adds slots from first_slot on to both ears (equal lengths, at least those of the nodes); from the middle of the slot before it the
  /// sound grows as linearly in power as LateSynthesizer's, told to stop there, falls.  offset: as there.
  void add(const LateNodes& nodes, int first_slot, const EarNoise& noise, std::size_t offset, const ListenerOrientation& orientation,
           std::span<float> left, std::span<float> right);

 private:
  void make_mixes(const LateNodes& nodes, int first_slot, const EarNoise& noise, const ListenerOrientation& orientation);

  HarmonicRotation rotation_{1};
  std::vector<EarNoise::Mix> mixes_;  ///< [band][slot], times the amplitude there; of slots with sound
};

}  // namespace earshot
