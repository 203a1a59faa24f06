#pragma once

#include <memory>
#include <span>

#include "sim/audio/fft.h"

namespace earshot {

/// STFT magnitude (512-point FFT, hop 160, Hann 400 centred in 512, frames centred with zero padding), 4 x 4 mean with zero padding, log(1
/// + x).
struct SpectrogramConfig {
  float sample_rate_hz = 16000.f;
  int num_samples = 16000;  ///< length of the window that is analysed
  int fft_size = 512, hop = 160, window = 400, pool = 4;
  [[nodiscard]] int num_frames() const { return 1 + num_samples / hop; }           ///< 101
  [[nodiscard]] int rows() const { return (fft_size / 2 + 1 + pool - 1) / pool; }  ///< 65
  [[nodiscard]] int columns() const { return (num_frames() + pool - 1) / pool; }   ///< 26
};

/// Owns the FFT and scratch: one per thread.
class SpectrogramAnalyzer {
 public:
  explicit SpectrogramAnalyzer(const SpectrogramConfig& config);
  ~SpectrogramAnalyzer();
  SpectrogramAnalyzer(SpectrogramAnalyzer&&) noexcept;
  /// sound: [2, num_samples]; spectrogram: [rows, columns, 2].  About 0.2 ms; no allocation.
  void analyze(std::span<const float> sound, std::span<float> spectrogram);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
