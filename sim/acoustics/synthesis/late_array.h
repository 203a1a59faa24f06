// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/late_carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"
#include "sim/audio/head/directivity.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/audio/head/listener_orientation.h"
#include "sim/audio/transforms/fft.h"

namespace earshot {

/// A late field at one pose of an array.
struct LateFieldAtArray {
  const EnergyHistogram& energy;
  double onset_sample;    ///< no sound before it
  const CarrierKey& key;  ///< of its noise
  const ListenerOrientation& orientation;
  float speed_of_sound_m_per_s;
};

/// Late sound at the microphones of an array: plane waves with independent noise from directions spread evenly over the sphere, each with
/// the delay of its way to a microphone and the gain of that microphone's pattern.  In every bin (late_envelope.h) and band the waves
/// divide the energy as exp(k cos) about its mean direction (von Mises and Fisher), with k from the length of that mean: even in a diffuse
/// field, positive always, exact in energy.  A diffuse field has the coherence sin(k d) / (k d) between two omnidirectional microphones
/// within 0.05 up to k d = 13, which is 4 kHz at 0.175 m; farther apart, where it should be near 0, it stays within 0.1 rms.  So have two
/// places of the array itself, which the waves pass in the order of their directions. Sums of many
/// noises cannot be flattened: the T20 of a microphone scatters like that of any noise (docs/explanation/estimators.md, section 6, up to 13
/// % in the lowest octaves of a short decay), as it does in a real room.
class LateArray {
 public:
  static constexpr int kNumWaves = 96;
  /// Streams of LateCarriers from this one on, one per wave.
  static constexpr std::uint32_t kFirstStream = 16;
  /// microphones must outlive this.
  LateArray(const BandLayout& bands, float sample_rate_hz, int num_samples, const std::vector<Microphone>& microphones);

  /// out: [microphone][num_samples], added to.  patterns: of the microphones.  carriers: kNumWaves channels.
  void render(const LateFieldAtArray& field, const CarrierBank& carriers, LateCarriers& place, std::span<const BandDirectivity> patterns,
              std::span<float> out);

 private:
  void weigh_waves(const EnergyHistogram& energy);
  void sound_wave(const EnergyHistogram& energy, const CarrierBank& carriers, LateCarriers& place, std::size_t wave, std::size_t ahead);

  const std::vector<Microphone>& microphones_;
  int num_bands_;
  float rate_hz_;
  std::size_t num_samples_, guard_;
  RealFft fft_;
  BandFilters filters_;
  LateEnvelope envelope_;
  std::vector<glm::vec3> direction_;  ///< world
  std::vector<float> weight_;         ///< [band][bin][wave], sum 1 over waves
  std::vector<float> signal_;         ///< of one wave, then of one microphone
  std::vector<std::complex<float>> wave_spectrum_, path_;
  std::vector<std::vector<std::complex<float>>> microphone_spectrum_;
  std::vector<float> band_gain_, gain_;
};

}  // namespace earshot
