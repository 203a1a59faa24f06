// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/spectrogram.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numeric>
#include <vector>

#include "sim/audio/transforms/stft_frames.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {

namespace {

/// log(1 + x) for x >= 0 within 2 units in the last place, as a plain loop that the compiler vectorizes; NaN for infinity.  Polynomial of
/// the Cephes library (Moshier 1989, logf), with the rounding of 1 + x made good by its first-order term.
void log1p_of(std::span<float> values) {
  constexpr float high_ln2 = 0.693359375f, low_ln2 = -2.12194440e-4f;
  constexpr std::int32_t mantissa_bits = 23, half_root = 0x3F3504F3;  // sqrt(1/2)
  float* out = values.data();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float x = out[i], y = 1.f + x, lost = (x - (y - 1.f)) / y;
    // y = 2^exponent * (1 + f), f in [sqrt(1/2) - 1, sqrt(2) - 1).
    const std::int32_t bits = std::bit_cast<std::int32_t>(y) - half_root;
    const auto exponent = static_cast<float>(bits >> mantissa_bits);
    const float f = std::bit_cast<float>((bits & ((1 << mantissa_bits) - 1)) + half_root) - 1.f;
    float p = 7.0376836292e-2f;
    p = p * f - 1.1514610310e-1f;
    p = p * f + 1.1676998740e-1f;
    p = p * f - 1.2420140846e-1f;
    p = p * f + 1.4249322787e-1f;
    p = p * f - 1.6668057665e-1f;
    p = p * f + 2.0000714765e-1f;
    p = p * f - 2.4999993993e-1f;
    p = p * f + 3.3333331174e-1f;
    const float square = f * f;
    const float tail = p * f * square + low_ln2 * exponent - 0.5f * square;
    out[i] = (f + tail + high_ln2 * exponent) + lost;
  }
}

/// Sums of `pool` neighbours, the last of what is left.
void sum_rows(const float* magnitude, std::size_t num_bins, std::size_t pool, std::span<float> rows) {
  const std::size_t whole = num_bins / pool;
  if (pool == 4) {
    for (std::size_t row = 0; row < whole; ++row) {
      const float* m = magnitude + 4 * row;
      rows[row] = ((m[0] + m[1]) + m[2]) + m[3];
    }
  } else {
    for (std::size_t row = 0; row < whole; ++row) rows[row] = std::accumulate(magnitude + row * pool, magnitude + (row + 1) * pool, 0.f);
  }
  if (whole < rows.size()) rows[whole] = std::accumulate(magnitude + whole * pool, magnitude + num_bins, 0.f);
}

}  // namespace

struct SpectrogramAnalyzer::Impl {
  explicit Impl(const SpectrogramConfig& settings)
      : config(settings),
        stft(settings),
        num_frames(static_cast<std::size_t>(settings.num_frames())),
        rows(static_cast<std::size_t>(settings.rows())),
        columns(static_cast<std::size_t>(settings.columns())),
        magnitude(stft.num_bins()),
        pooled(rows) {}

  /// Magnitudes of one frame of one channel, summed over the bins of each row.
  void analyze_frame(std::span<const float> sound, std::size_t index, std::span<float> sums) {
    const std::complex<float>* bins = stft.spectrum_of(sound, index).data();
    float* squares = magnitude.data();
    for (std::size_t k = 0; k < magnitude.size(); ++k) squares[k] = bins[k].real() * bins[k].real() + bins[k].imag() * bins[k].imag();
    for (std::size_t k = 0; k < magnitude.size(); ++k) squares[k] = std::sqrt(squares[k]);
    sum_rows(squares, magnitude.size(), static_cast<std::size_t>(config.pool), sums);
  }

  /// Mean over the frames of each column and its logarithm: to every num_channels-th value.
  void pool_columns(std::span<const float> frames, std::size_t channel, std::size_t num_channels, std::span<float> spectrogram) {
    const auto pool = static_cast<std::size_t>(config.pool);
    const float pool_area = static_cast<float>(config.pool * config.pool);
    for (std::size_t column = 0; column < columns; ++column) {
      std::ranges::fill(pooled, 0.f);
      for (std::size_t t = column * pool; t < std::min((column + 1) * pool, num_frames); ++t) {
        const float* sums = frames.data() + t * rows;
        for (std::size_t row = 0; row < rows; ++row) pooled[row] += sums[row];
      }
      for (float& value : pooled) value /= pool_area;
      log1p_of(pooled);
      for (std::size_t row = 0; row < rows; ++row) spectrogram[num_channels * (row * columns + column) + channel] = pooled[row];
    }
  }

  SpectrogramConfig config;
  StftFrames stft;
  std::size_t num_frames, rows, columns;
  std::vector<float> magnitude;
  std::vector<float> pooled;           ///< one column
  SpectrogramHistory default_history;  ///< of callers that keep none
};

SpectrogramAnalyzer::SpectrogramAnalyzer(const SpectrogramConfig& config) : impl_(std::make_unique<Impl>(config)) {}
SpectrogramAnalyzer::~SpectrogramAnalyzer() = default;
SpectrogramAnalyzer::SpectrogramAnalyzer(SpectrogramAnalyzer&&) noexcept = default;

void SpectrogramAnalyzer::analyze(std::span<const float> sound, std::span<float> spectrogram) {
  impl_->default_history.forget();
  analyze(sound, 0, impl_->default_history, spectrogram);
}

void SpectrogramAnalyzer::analyze(std::span<const float> sound, std::size_t new_samples, SpectrogramHistory& history,
                                  std::span<float> spectrogram) {
  const FlushDenormals flush;
  Impl& in = *impl_;
  const auto samples = static_cast<std::size_t>(in.config.num_samples), hop = static_cast<std::size_t>(in.config.hop);
  const std::size_t num_channels = sound.size() / samples;
  EARSHOT_EXPECT(num_channels > 0 && sound.size() == num_channels * samples && spectrogram.size() == num_channels * in.rows * in.columns);
  const std::size_t per_channel = in.num_frames * in.rows;
  history.rows_.resize(num_channels * per_channel);
  const std::size_t moved = new_samples / hop;
  const bool known = history.valid_ && new_samples % hop == 0;
  for (std::size_t channel = 0; channel < num_channels; ++channel) {
    const std::span<float> frames = std::span(history.rows_).subspan(channel * per_channel, per_channel);
    if (known && moved > 0 && moved < in.num_frames)
      std::copy(frames.begin() + static_cast<std::ptrdiff_t>(moved * in.rows), frames.end(), frames.begin());
    for (std::size_t t = 0; t < in.num_frames; ++t) {
      const bool cached = known && t + moved < in.num_frames && in.stft.inside(t) && in.stft.inside(t + moved);
      if (!cached) in.analyze_frame(sound.subspan(channel * samples, samples), t, frames.subspan(t * in.rows, in.rows));
    }
    in.pool_columns(frames, channel, num_channels, spectrogram);
  }
  history.valid_ = true;
}

}  // namespace earshot
