#pragma once

#include <array>
#include <complex>
#include <memory>
#include <vector>

#include "sim/acoustics/band_filters.h"
#include "sim/acoustics/carriers.h"
#include "sim/acoustics/rir_synthesis.h"

namespace earshot {

/// See make_synthesis_tables.
class SynthesisTables {
 public:
  SynthesisTables(const AcousticConfig& config, const BandLayout& band_layout, ListenerLayout listener_layout,
                  std::shared_ptr<const Hrtf> head);

  BandLayout bands;
  ListenerLayout layout;
  std::shared_ptr<const Hrtf> hrtf;  ///< binaural, else null
  float sample_rate_hz;
  int num_samples, num_bands;
  std::uint64_t seed;
  int early_fft, late_fft = 4;
  BandFilters filters;
  CarrierBank carriers;
  std::array<std::vector<std::complex<float>>, 8> decoder;  ///< binaural: [channel * 2 + ear][late_fft / 2 + 1]
  std::vector<BandDirectivity> patterns;                    ///< of the microphones
};

}  // namespace earshot
