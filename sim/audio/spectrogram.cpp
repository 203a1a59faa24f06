#include "sim/audio/spectrogram.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

struct SpectrogramAnalyzer::Impl {
  explicit Impl(const SpectrogramConfig& settings)
      : config(settings),
        fft(settings.fft_size),
        window(settings.window),
        frame(settings.fft_size, 0.f),
        spectrum(fft.num_bins()),
        pooled(static_cast<std::size_t>(settings.rows()) * settings.columns()) {
    // Periodic Hann window, as in librosa (scipy.signal.get_window with fftbins).
    for (int i = 0; i < config.window; ++i)
      window[i] = static_cast<float>(0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * i / config.window));
  }

  /// Writes the windowed frame centred at `centre` of one channel into the middle of `frame`.
  void cut_frame(std::span<const float> sound, int centre) {
    const int offset = (config.fft_size - config.window) / 2;
    const int first = centre - config.fft_size / 2 + offset;  // sound sample under window[0]
    const int begin = std::clamp(-first, 0, config.window);
    const int end = std::clamp(config.num_samples - first, begin, config.window);
    float* target = frame.data() + offset;
    std::fill(target, target + begin, 0.f);
    for (int i = begin; i < end; ++i) target[i] = window[i] * sound[static_cast<std::size_t>(first + i)];
    std::fill(target + end, target + config.window, 0.f);
  }

  /// Adds the magnitude of the frame's spectrum to one column of `pooled`.
  void add_to_column(int column) {
    fft.forward(frame, spectrum);
    const int columns = config.columns(), rows = config.rows(), pool = config.pool, num_bins = static_cast<int>(spectrum.size());
    const std::complex<float>* bins = spectrum.data();
    float* squares = magnitude.data();
    for (int k = 0; k < num_bins; ++k) squares[k] = bins[k].real() * bins[k].real() + bins[k].imag() * bins[k].imag();
    for (int k = 0; k < num_bins; ++k) squares[k] = std::sqrt(squares[k]);
    for (int row = 0; row < rows; ++row) {
      float sum = 0;
      for (int k = row * pool; k < std::min((row + 1) * pool, num_bins); ++k) sum += magnitude[k];
      pooled[static_cast<std::size_t>(row) * columns + column] += sum;
    }
  }

  SpectrogramConfig config;
  RealFft fft;
  std::vector<float> window, frame;
  std::vector<std::complex<float>> spectrum;
  std::vector<float> pooled;  ///< [rows, columns] of one channel
  std::vector<float> magnitude = std::vector<float>(spectrum.size());
};

SpectrogramAnalyzer::SpectrogramAnalyzer(const SpectrogramConfig& config) {
  require(config.num_samples > 0, "spectrogram.num_samples", config.num_samples, "must be positive");
  require(config.hop > 0, "spectrogram.hop", config.hop, "must be positive");
  require(config.window > 0 && config.window <= config.fft_size, "spectrogram.window", config.window, "must be in [1, fft_size]");
  require(config.pool > 0, "spectrogram.pool", config.pool, "must be positive");
  impl_ = std::make_unique<Impl>(config);
}
SpectrogramAnalyzer::~SpectrogramAnalyzer() = default;
SpectrogramAnalyzer::SpectrogramAnalyzer(SpectrogramAnalyzer&&) noexcept = default;

void SpectrogramAnalyzer::analyze(std::span<const float> sound, std::span<float> spectrogram) {
  const SpectrogramConfig& config = impl_->config;
  const auto samples = static_cast<std::size_t>(config.num_samples);
  EARSHOT_EXPECT(sound.size() == 2 * samples && spectrogram.size() == 2 * impl_->pooled.size());
  const float pool_area = static_cast<float>(config.pool * config.pool);
  for (std::size_t channel = 0; channel < 2; ++channel) {
    std::fill(impl_->pooled.begin(), impl_->pooled.end(), 0.f);
    for (int frame = 0; frame < config.num_frames(); ++frame) {
      impl_->cut_frame(sound.subspan(channel * samples, samples), frame * config.hop);
      impl_->add_to_column(frame / config.pool);
    }
    for (std::size_t i = 0; i < impl_->pooled.size(); ++i) spectrogram[2 * i + channel] = std::log1p(impl_->pooled[i] / pool_area);
  }
}

}  // namespace earshot
