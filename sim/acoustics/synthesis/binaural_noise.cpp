// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/binaural_noise.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/denormals.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;
using Spectrum = std::vector<Complex>;
using Decoder = std::array<Spectrum, 8>;

/// Decoder filters on the bins of a long transform, with time zero at sample zero: [channel * 2 + ear].
Decoder long_decoder(const Hrtf& hrtf, RealFft& fft) {
  RealFft short_fft(hrtf.fft_size());
  std::vector<float> taps(static_cast<std::size_t>(hrtf.fft_size()));
  const auto num_taps = static_cast<std::size_t>(hrtf.decoder_taps());
  Decoder decoder;
  for (std::size_t i = 0; i < decoder.size(); ++i) {
    short_fft.inverse(hrtf.diffuse_decoder(static_cast<int>(i / 2), static_cast<int>(i % 2)), taps);
    decoder[i].resize(static_cast<std::size_t>(fft.num_bins()));
    fft.forward(std::span(taps).first(num_taps), decoder[i]);
    const double phase_per_bin = 2.0 * std::numbers::pi * hrtf.lead_samples() / fft.size();
    for (std::size_t k = 0; k < decoder[i].size(); ++k) decoder[i][k] *= Complex(std::polar(1.0, phase_per_bin * static_cast<double>(k)));
  }
  return decoder;
}

}  // namespace

BinauralNoise::BinauralNoise(const CarrierBank& carriers, const BandLayout& bands, const Hrtf& hrtf)
    : length_(carriers.length()),
      samples_(static_cast<std::size_t>(carriers.num_kinds() * bands.size()) * 2 * (carriers.length() + CarrierBank::kPad)),
      bands_(static_cast<std::size_t>(bands.size())) {
  const auto length = static_cast<int>(length_);
  RealFft fft(length);
  const Decoder decoder = long_decoder(hrtf, fft);
  const BandFilters filters(bands, hrtf.sample_rate_hz(), length);
  tbb::parallel_for(0, bands.size(), [&](int band) {
    const FlushDenormals flush;
    find_covariances(band, filters, decoder);
    for (int kind = 0; kind < carriers.num_kinds(); ++kind) make_noise(band, kind, carriers, decoder);
  });
}

/// Over those of white noise in each channel, of which a band's carrier has the weight F_b as amplitude, and nothing at the two ends of its
/// spectrum.
void BinauralNoise::find_covariances(int band, const BandFilters& filters, const Decoder& decoder) {
  const auto gram = [&](std::size_t ear, std::size_t other_ear, std::size_t c, std::size_t d) {
    double sum = 0;
    for (std::size_t k = 1; k + 1 < filters.num_bins(); ++k) {
      const double weight = static_cast<double>(filters.weight(band, k));
      if (weight == 0.0) continue;
      const std::complex<double> a(decoder[2 * c + ear][k]), b(decoder[2 * d + other_ear][k]);
      sum += weight * weight * (a.real() * b.real() + a.imag() * b.imag());
    }
    return sum / static_cast<double>(filters.num_bins() - 1);
  };
  const auto form = [&](std::size_t ear, std::size_t other_ear) {
    const auto symmetric = [&](std::size_t c, std::size_t d) { return gram(ear, other_ear, c, d) + gram(ear, other_ear, d, c); };
    // Beside what they have of channel 0, channels 1 to 3 hold d^2 = 1 - |m|^2 / 3 each.
    const std::array<double, 3> diagonal = {gram(ear, other_ear, 1, 1), gram(ear, other_ear, 2, 2), gram(ear, other_ear, 3, 3)};
    const double diffuse = diagonal[0] + diagonal[1] + diagonal[2];
    const std::array<double, 10> exact = {gram(ear, other_ear, 0, 0) + diffuse,
                                          symmetric(0, 1),
                                          symmetric(0, 2),
                                          symmetric(0, 3),
                                          diagonal[0] - diffuse / 3,
                                          diagonal[1] - diffuse / 3,
                                          diagonal[2] - diffuse / 3,
                                          symmetric(1, 2),
                                          symmetric(1, 3),
                                          symmetric(2, 3)};
    Form result;
    std::ranges::transform(exact, result.c.begin(), [](double value) { return static_cast<float>(value); });
    return result;
  };
  Band& of_band = bands_[static_cast<std::size_t>(band)];
  of_band.left = form(0, 0), of_band.right = form(1, 1), of_band.cross = form(0, 1);
}

void BinauralNoise::make_noise(int band, int kind, const CarrierBank& carriers, const Decoder& decoder) {
  RealFft fft(static_cast<int>(length_));
  const std::size_t num_bins = decoder[0].size();
  Spectrum carrier(num_bins);
  std::array<Spectrum, 2> ears = {Spectrum(num_bins), Spectrum(num_bins)};
  for (std::size_t c = 0; c < 4; ++c) {
    fft.forward(carriers.loop(band, static_cast<int>(c), kind), carrier);
    for (std::size_t ear = 0; ear < 2; ++ear)
      for (std::size_t k = 0; k < num_bins; ++k) ears[ear][k] += carrier[k] * decoder[2 * c + ear][k];
  }
  // Powers of this very noise rather than those expected of any: then a whole loop has the required powers, but for rounding.
  const double scale = 2.0 / (static_cast<double>(length_) * static_cast<double>(length_));
  double left = 0, right = 0, cross = 0;
  for (std::size_t k = 0; k < num_bins; ++k) {
    const std::complex<double> a(ears[0][k]), b(ears[1][k]);
    left += scale * std::norm(a);
    right += scale * std::norm(b);
    cross += scale * (a.real() * b.real() + a.imag() * b.imag());
  }
  const double shared = left > 0 ? cross / left : 0.0, residual = right - shared * cross;
  Band& of_band = bands_[static_cast<std::size_t>(band)];
  for (std::size_t k = 0; k < num_bins; ++k) ears[1][k] -= static_cast<float>(shared) * ears[0][k];
  if (kind == 0) {
    of_band.one_over_left = left > 0 ? static_cast<float>(1 / left) : 0.f;
    of_band.one_over_own = residual > 0 ? static_cast<float>(1 / residual) : 0.f;
  } else {
    // The powers of kind 0: one mixture serves all.
    const auto gain_to = [](double power, float one_over_wanted) {
      return power > 0 && one_over_wanted > 0.f ? static_cast<float>(1 / std::sqrt(power * static_cast<double>(one_over_wanted))) : 0.f;
    };
    const float left_gain = gain_to(left, of_band.one_over_left), own_gain = gain_to(residual, of_band.one_over_own);
    for (Complex& bin : ears[0]) bin *= left_gain;
    for (Complex& bin : ears[1]) bin *= own_gain;
  }
  for (std::size_t part = 0; part < 2; ++part) {
    const std::size_t stride = length_ + CarrierBank::kPad;
    const std::size_t row = 2 * (static_cast<std::size_t>(kind) * bands_.size() + static_cast<std::size_t>(band)) + part;
    const auto samples = std::span(samples_).subspan(row * stride, stride);
    fft.inverse(ears[part], samples.first(length_));
    for (std::size_t n = length_; n < stride; ++n) samples[n] = samples[n - length_];
  }
}

BinauralNoise::Mix BinauralNoise::mix(int band, const std::array<float, 3>& m) const {
  const Band& of_band = bands_[static_cast<std::size_t>(band)];
  const std::array<float, 10> products = {1.f,         m[0],        m[1],        m[2],        m[0] * m[0],
                                          m[1] * m[1], m[2] * m[2], m[0] * m[1], m[0] * m[2], m[1] * m[2]};
  const float left_power = std::max(of_band.left.at(products), 0.f), right_power = std::max(of_band.right.at(products), 0.f);
  // Part 0 has the left ear's diffuse power P: left = sqrt(left_power / P), and shared left P is the required correlation.
  const float left = std::sqrt(left_power * of_band.one_over_left);
  const float shared = left > 0.f ? of_band.cross.at(products) * of_band.one_over_left / left : 0.f;
  const float shared_power = of_band.one_over_left > 0.f ? shared * shared / of_band.one_over_left : 0.f;
  if (!(shared_power < right_power)) {  // one signal at both ears, or rounding beyond that
    const float sign = shared < 0.f ? -1.f : 1.f;
    return {left, sign * std::sqrt(right_power * of_band.one_over_left), 0.f};
  }
  return {left, shared, std::sqrt((right_power - shared_power) * of_band.one_over_own)};
}

}  // namespace earshot
