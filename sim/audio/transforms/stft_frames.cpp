// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/stft_frames.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

const SpectrogramConfig& checked(const SpectrogramConfig& config) {
  require(config.num_samples > 0, "spectrogram.num_samples", config.num_samples, "must be positive");
  require(config.hop > 0, "spectrogram.hop", config.hop, "must be positive");
  require(config.window > 0 && config.window <= config.fft_size, "spectrogram.window", config.window, "must be in [1, fft_size]");
  require(config.pool > 0, "spectrogram.pool", config.pool, "must be positive");
  return config;
}

}  // namespace

StftFrames::StftFrames(const SpectrogramConfig& config)
    : config_(checked(config)),
      fft_(config.fft_size),
      window_(static_cast<std::size_t>(config.window)),
      frame_(static_cast<std::size_t>(config.fft_size), 0.f),
      spectrum_(fft_.num_bins()) {
  // As scipy.signal.get_window with fftbins.
  for (std::size_t i = 0; i < window_.size(); ++i)
    window_[i] = static_cast<float>(0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * static_cast<double>(i) / config_.window));
}

int StftFrames::first_sample(std::size_t index) const {
  return static_cast<int>(index) * config_.hop - config_.fft_size / 2 + (config_.fft_size - config_.window) / 2;
}

bool StftFrames::inside(std::size_t index) const {
  return first_sample(index) >= 0 && first_sample(index) + config_.window <= config_.num_samples;
}

std::span<const std::complex<float>> StftFrames::spectrum_of(std::span<const float> sound, std::size_t index) {
  const int first = first_sample(index);
  const int begin = std::clamp(-first, 0, config_.window), end = std::clamp(config_.num_samples - first, begin, config_.window);
  float* target = frame_.data() + (config_.fft_size - config_.window) / 2;
  const float* source = sound.data() + first;  // only [begin, end) of it is read
  std::fill(target, target + begin, 0.f);
  for (int i = begin; i < end; ++i) target[i] = window_[static_cast<std::size_t>(i)] * source[i];
  std::fill(target + end, target + config_.window, 0.f);
  fft_.forward(frame_, spectrum_);
  return spectrum_;
}

}  // namespace earshot
