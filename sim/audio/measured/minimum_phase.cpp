// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/minimum_phase.h"

namespace earshot {

MinimumPhase::MinimumPhase(int size)
    : fft_(size), spectrum_(static_cast<std::size_t>(fft_.num_bins())), cepstrum_(static_cast<std::size_t>(size)) {}

void MinimumPhase::operator()(std::span<const float> log_magnitude, std::span<float> phase_rad) {
  for (std::size_t k = 0; k < spectrum_.size(); ++k) spectrum_[k] = log_magnitude[k];
  fft_.inverse(spectrum_, cepstrum_);
  // Causal: the part before time zero is added to the part after it.  Only its odd part, the phase, is needed.
  const std::size_t half = cepstrum_.size() / 2;
  cepstrum_[0] = cepstrum_[half] = 0.f;
  for (std::size_t n = 1; n < half; ++n) {
    cepstrum_[n] *= 2.f;
    cepstrum_[half + n] = 0.f;
  }
  fft_.forward(cepstrum_, spectrum_);
  for (std::size_t k = 0; k < spectrum_.size(); ++k) phase_rad[k] = spectrum_[k].imag();
}

}  // namespace earshot
