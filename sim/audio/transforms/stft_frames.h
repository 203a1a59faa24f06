// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrogram.h"

namespace earshot {

/// Spectra of the frames of a window of sound: periodic Hann window of config.window samples centred in config.fft_size, every config.hop
/// samples, the first frame centred on the first sample, zeros outside.  As librosa's stft with center.  One thread.
class StftFrames {
 public:
  /// Throws InputError for sizes that make no frames.
  explicit StftFrames(const SpectrogramConfig& config);

  [[nodiscard]] std::size_t num_bins() const { return spectrum_.size(); }
  /// Whether the frame lies wholly inside the sound: then it is the same wherever that sound stands in a window.
  [[nodiscard]] bool inside(std::size_t index) const;
  /// Spectrum [num_bins] of one frame of sound [num_samples]; valid until the next call.
  std::span<const std::complex<float>> spectrum_of(std::span<const float> sound, std::size_t index);

 private:
  /// Sample of the sound under the first one of the window of a frame.
  [[nodiscard]] int first_sample(std::size_t index) const;

  SpectrogramConfig config_;
  RealFft fft_;
  std::vector<float> window_, frame_;
  std::vector<std::complex<float>> spectrum_;
};

}  // namespace earshot
