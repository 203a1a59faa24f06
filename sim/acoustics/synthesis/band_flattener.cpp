// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/band_flattener.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Standard deviations of the Gaussian windows in inverse bandwidths: of the covariance of all channels, and of the power of each.  Least
/// T20 error over mono and ears (rms 1.1 and 1.8 %; 1.2 for both gives 1.2 and 2.3 %).
constexpr double kWideWindow = 2.3, kNarrowWindow = 1.1;
/// Keeps the local covariance invertible, relative to its mean.
constexpr float kRegularization = 1e-3f;
/// Of the narrow window, relative to the power of one channel; largest gain of a deep gap.
constexpr float kMinPower = 1e-6f;

std::size_t last_bin(const BandFilters& filters, int band) {
  std::size_t last = 1;
  for (std::size_t k = 0; k < filters.num_bins(); ++k)
    if (filters.weight(band, k) > 0) last = k;
  return last;
}

/// Samples that hold the band and as much room above it for what flattening spreads.
int reduced_length(const BandFilters& filters, int band, int length) {
  return std::min(length, next_power_of_two(static_cast<int>(4 * last_bin(filters, band))));
}

}  // namespace

BandFlattener::BandFlattener(std::size_t num_channels, int length, const BandFilters& filters, int band)
    : num_channels_(num_channels),
      length_(static_cast<std::size_t>(reduced_length(filters, band, length))),
      fft_(static_cast<int>(length_)),
      weight_(length_ / 2 + 1),
      wide_(weight_.size()),
      narrow_(weight_.size()),
      plane_(length_),
      bins_(weight_.size()) {
  EARSHOT_EXPECT(num_channels >= 1 && num_channels <= kMaxChannels && filters.num_bins() == static_cast<std::size_t>(length / 2 + 1));
  double width_bins = 0;
  for (std::size_t k = 0; k < weight_.size(); ++k) width_bins += static_cast<double>(weight_[k] = filters.weight(band, k));
  // Analytic signals have twice the power of the band; unit white noise has length / 2 bins of power `length`.
  scale_ = static_cast<float>(std::sqrt(4.0 * width_bins / length) * length / static_cast<double>(length_));
  for (std::size_t k = 0; k < weight_.size(); ++k) {
    const double x = 2.0 * std::numbers::pi * static_cast<double>(k) / width_bins;
    wide_[k] = static_cast<float>(std::exp(-0.5 * x * x * kWideWindow * kWideWindow));
    narrow_[k] = static_cast<float>(std::exp(-0.5 * x * x * kNarrowWindow * kNarrowWindow));
  }
  for (std::size_t i = 0; i < num_channels_; ++i) {
    signal_[i].resize(length_);
    for (std::size_t j = 0; j < num_channels_; ++j) covariance_[i][j].resize(length_);
  }
}

void BandFlattener::flatten(std::span<const std::vector<Complex>> noise) {
  for (std::size_t c = 0; c < num_channels_; ++c) cut_band(noise[c], signal_[c]);
  measure_covariance();
  for (std::size_t n = 0; n < length_; ++n) whiten(n);
  for (std::size_t c = 0; c < num_channels_; ++c) {
    for (std::size_t n = 0; n < length_; ++n) plane_[n] = std::norm(signal_[c][n]);
    smooth(plane_, narrow_);
    for (std::size_t n = 0; n < length_; ++n) plane_[n] = scale_ * signal_[c][n].real() / std::sqrt(std::max(plane_[n], kMinPower));
    fft_.forward(plane_, std::span(signal_[c]).first(bins_.size()));
  }
}

void BandFlattener::add_to(std::size_t channel, std::span<Complex> spectrum) const {
  for (std::size_t k = 0; k < bins_.size(); ++k) spectrum[k] += signal_[channel][k];
}

/// The band and its Hilbert transform as one complex signal.
void BandFlattener::cut_band(std::span<const Complex> spectrum, std::span<Complex> signal) {
  for (std::size_t k = 0; k < bins_.size(); ++k) bins_[k] = weight_[k] * spectrum[k];
  fft_.inverse(bins_, plane_);
  for (std::size_t n = 0; n < length_; ++n) signal[n] = plane_[n];
  for (Complex& bin : bins_) bin = {bin.imag(), -bin.real()};  // times -i
  fft_.inverse(bins_, plane_);
  for (std::size_t n = 0; n < length_; ++n) signal[n].imag(plane_[n]);
}

void BandFlattener::smooth(std::span<float> values, std::span<const float> window) {
  fft_.forward(values, bins_);
  for (std::size_t k = 0; k < bins_.size(); ++k) bins_[k] *= window[k];
  fft_.inverse(bins_, values);
}

/// Local Hermitian covariance: real parts in the lower triangle and the diagonal, imaginary parts of (i, j), i > j, in (j, i).
void BandFlattener::measure_covariance() {
  for (std::size_t i = 0; i < num_channels_; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      for (std::size_t n = 0; n < length_; ++n) {
        const Complex a = signal_[i][n], b = signal_[j][n];
        covariance_[i][j][n] = a.real() * b.real() + a.imag() * b.imag();
        if (i != j) covariance_[j][i][n] = a.imag() * b.real() - a.real() * b.imag();
      }
      smooth(covariance_[i][j], wide_);
      if (i != j) smooth(covariance_[j][i], wide_);
    }
  }
}

/// Multiplies the channels at one sample by the inverse Cholesky factor of their covariance: channel 0 is only rescaled, each further
/// channel loses the part that is locally coherent with those before it.  So channel 0 is the same for every number of channels.
void BandFlattener::whiten(std::size_t n) {
  PerChannel<PerChannel<Complex>> factor;
  PerChannel<Complex> white;
  for (std::size_t i = 0; i < num_channels_; ++i) {
    const float floor = kRegularization * std::abs(covariance_[i][i][n]);
    Complex rest = signal_[i][n];
    for (std::size_t j = 0; j < i; ++j) {
      Complex sum(covariance_[i][j][n], covariance_[j][i][n]);
      for (std::size_t k = 0; k < j; ++k) sum -= factor[i][k] * std::conj(factor[j][k]);
      factor[i][j] = sum / factor[j][j].real();
      rest -= factor[i][j] * white[j];
    }
    float power = covariance_[i][i][n] + floor;
    for (std::size_t k = 0; k < i; ++k) power -= std::norm(factor[i][k]);
    factor[i][i] = std::sqrt(std::max(power, std::max(floor, 1e-20f)));
    white[i] = rest / factor[i][i].real();
  }
  for (std::size_t i = 0; i < num_channels_; ++i) signal_[i][n] = white[i];
}

}  // namespace earshot
