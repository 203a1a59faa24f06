// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <memory>
#include <optional>
#include <vector>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/acoustics/synthesis/binaural_noise.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/transforms/complex_fft.h"
#include "sim/audio/transforms/low_pass.h"

namespace earshot {

/// See make_synthesis_tables.
class SynthesisTables {
 public:
  SynthesisTables(const AcousticConfig& config, const BandLayout& band_layout, ListenerLayout listener_layout,
                  std::shared_ptr<const Hrtf> head);

  BandLayout bands;
  ListenerLayout layout;
  bool has_plane_waves;              ///< the late field of an array is that of late_array.h; else first-order harmonics tell it
  std::shared_ptr<const Hrtf> hrtf;  ///< binaural, else null
  float sample_rate_hz;
  int num_samples, num_bands, glide_paths;
  std::uint64_t seed;
  int early_fft, late_fft = 4;
  BandFilters filters;  ///< of arrivals
  CarrierBank carriers;
  BinauralNoise binaural_noise;  ///< binaural
  double late_decode_samples;    ///< from the first late sound on
  /// Binaural: decoder of the late field with the left ear as real and the right one as imaginary part.  Channels come in two pairs, the
  /// second of each as imaginary part: with Z the spectrum of a pair, Z~(k) = conj Z(-k), both ears are
  /// sum over pairs of decoder[2 pair] Z + decoder[2 pair + 1] Z~.  [late_fft] each, divided by late_fft.
  std::array<AlignedSpectrum, 4> decoder;
  std::vector<BandDirectivity> patterns;           ///< of the microphones
  std::vector<std::optional<LowPass>> low_passes;  ///< likewise; none at all where no microphone has one

 private:
  void make_decoder();
};

}  // namespace earshot
