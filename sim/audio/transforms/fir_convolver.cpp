// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/fir_convolver.h"

#include <algorithm>
#include <cstddef>

#include "sim/base/errors.h"

namespace earshot {

std::vector<float> FirConvolver::convolve(std::span<const float> signal, std::span<const float> filters, int num_channels) {
  const auto channels = static_cast<std::size_t>(num_channels);
  EARSHOT_EXPECT(num_channels > 0 && !filters.empty() && filters.size() % channels == 0);
  const std::size_t taps = filters.size() / channels;
  if (signal.empty()) return {};
  const int size = next_power_of_two(static_cast<int>(std::max<std::size_t>(2 * taps, 1024)));
  if (!fft_ || fft_->size() != size) fft_.emplace(size);
  const auto bins = static_cast<std::size_t>(fft_->num_bins()), length = static_cast<std::size_t>(size), hop = length - taps + 1;
  filter_spectra_.resize(channels * bins);
  spectrum_.resize(bins);
  product_.resize(bins);
  time_.resize(length);
  for (std::size_t c = 0; c < channels; ++c)
    fft_->forward(filters.subspan(c * taps, taps), std::span(filter_spectra_).subspan(c * bins, bins));

  const std::size_t frames = signal.size() + taps - 1;
  std::vector<float> result(channels * frames, 0.f);
  for (std::size_t begin = 0; begin < signal.size(); begin += hop) {
    fft_->forward(signal.subspan(begin, std::min(hop, signal.size() - begin)), spectrum_);
    const std::size_t count = std::min(length, frames - begin);
    for (std::size_t c = 0; c < channels; ++c) {
      for (std::size_t k = 0; k < bins; ++k) product_[k] = spectrum_[k] * filter_spectra_[c * bins + k];
      fft_->inverse(product_, time_);
      float* const out = result.data() + c * frames + begin;
      for (std::size_t n = 0; n < count; ++n) out[n] += time_[n];
    }
  }
  return result;
}

}  // namespace earshot
