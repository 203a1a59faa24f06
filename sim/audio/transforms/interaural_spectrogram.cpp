// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/interaural_spectrogram.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "sim/audio/transforms/stft_frames.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kSums = 4;  // left and right power, real and imaginary cross spectrum

}  // namespace

struct InterauralAnalyzer::Impl {
  explicit Impl(const SpectrogramConfig& settings)
      : config(settings),
        stft(settings),
        num_frames(static_cast<std::size_t>(settings.num_frames())),
        rows(static_cast<std::size_t>(settings.rows())),
        columns(static_cast<std::size_t>(settings.columns())),
        left(stft.num_bins()),
        pooled(kSums * rows) {
    // The power of a bin of white noise with deviation 1 is the energy of the window, three eighths of its length for Hann's.
    const float bin_power = 0.375f * static_cast<float>(settings.window);
    const auto area = static_cast<float>(settings.pool * settings.pool);
    scale = 1.f / (bin_power * area);
    floor = std::pow(10.f, kInterauralFloorDb / 10.f);
  }

  /// The sums of one frame [4, rows].
  void analyze_frame(std::span<const float> sound, std::size_t index, std::span<float> sums) {
    const std::size_t samples = sound.size() / 2, pool = static_cast<std::size_t>(config.pool);
    std::ranges::copy(stft.spectrum_of(sound.first(samples), index), left.begin());
    const std::span<const std::complex<float>> right = stft.spectrum_of(sound.last(samples), index);
    for (std::size_t row = 0; row < rows; ++row) {
      float p_left = 0, p_right = 0, real = 0, imaginary = 0;
      for (std::size_t k = row * pool; k < std::min((row + 1) * pool, left.size()); ++k) {
        const float a = left[k].real(), b = left[k].imag(), c = right[k].real(), d = right[k].imag();
        p_left += a * a + b * b;
        p_right += c * c + d * d;
        real += a * c + b * d;
        imaginary += b * c - a * d;
      }
      sums[row] = p_left;
      sums[rows + row] = p_right;
      sums[2 * rows + row] = real;
      sums[3 * rows + row] = imaginary;
    }
  }

  /// Cells of one column from the sums of its frames.
  void pool_column(std::span<const float> frames, std::size_t column, std::span<float> cells) {
    const auto pool = static_cast<std::size_t>(config.pool);
    std::ranges::fill(pooled, 0.f);
    for (std::size_t t = column * pool; t < std::min((column + 1) * pool, num_frames); ++t)
      for (std::size_t i = 0; i < pooled.size(); ++i) pooled[i] += frames[t * pooled.size() + i];
    for (std::size_t row = 0; row < rows; ++row) {
      const float p_left = pooled[row] * scale + floor, p_right = pooled[rows + row] * scale + floor;
      const float coherent = scale / std::sqrt(p_left * p_right);
      float* cell = cells.data() + kInterauralChannels * (row * columns + column);
      cell[0] = 10.f / kInterauralLevelDb * std::log10(0.5f * (p_left + p_right) / floor);
      cell[1] = 10.f / kInterauralDifferenceDb * std::log10(p_left / p_right);
      cell[2] = pooled[2 * rows + row] * coherent;
      cell[3] = pooled[3 * rows + row] * coherent;
    }
  }

  SpectrogramConfig config;
  StftFrames stft;
  std::size_t num_frames, rows, columns;
  std::vector<std::complex<float>> left;
  std::vector<float> pooled;  ///< [4, rows]
  float scale = 0, floor = 0;
};

InterauralAnalyzer::InterauralAnalyzer(const SpectrogramConfig& config) : impl_(std::make_unique<Impl>(config)) {}
InterauralAnalyzer::~InterauralAnalyzer() = default;
InterauralAnalyzer::InterauralAnalyzer(InterauralAnalyzer&&) noexcept = default;

void InterauralAnalyzer::analyze(std::span<const float> sound, std::size_t new_samples, InterauralHistory& history,
                                 std::span<float> cells) {
  const FlushDenormals flush;
  Impl& in = *impl_;
  const auto samples = static_cast<std::size_t>(in.config.num_samples), hop = static_cast<std::size_t>(in.config.hop);
  EARSHOT_EXPECT(sound.size() == 2 * samples && cells.size() == kInterauralChannels * in.rows * in.columns);
  const std::size_t per_frame = kSums * in.rows, moved = new_samples / hop;
  history.sums_.resize(in.num_frames * per_frame);
  const bool known = history.valid_ && new_samples % hop == 0;
  const std::span<float> sums = history.sums_;
  if (known && moved > 0 && moved < in.num_frames)
    std::copy(sums.begin() + static_cast<std::ptrdiff_t>(moved * per_frame), sums.end(), sums.begin());
  for (std::size_t t = 0; t < in.num_frames; ++t) {
    const bool cached = known && t + moved < in.num_frames && in.stft.inside(t) && in.stft.inside(t + moved);
    if (!cached) in.analyze_frame(sound, t, sums.subspan(t * per_frame, per_frame));
  }
  for (std::size_t column = 0; column < in.columns; ++column) in.pool_column(sums, column, cells);
  history.valid_ = true;
}

}  // namespace earshot
