// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/carriers.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <iterator>
#include <numbers>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/acoustics/synthesis/band_flattener.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Even passes flatten octaves, odd ones octaves half an octave higher: any octave is then flat.  Below 700 Hz, where few degrees of
/// freedom make the search long and short transforms make it cheap, there are more passes first.
constexpr int kLowPasses = 60, kPasses = 12;
constexpr double kLowHz = 710;
/// Streams of plain channels, apart from those of flattened ones.
constexpr std::size_t kFirstPlainChannel = 1 << 16;

/// Octaves from about 30 Hz up to half the rate, independent of the bands of a response.  Those below 125 Hz keep what lies under the
/// lowest octave that is measured from unsettling it.  shift: 0 for the usual midbands, 0.5 for octaves that straddle their edges.
BandLayout flattening_octaves(float sample_rate_hz, double shift) {
  BandLayout octaves;
  octaves.edge_hz.push_back(static_cast<float>(1000.0 * std::pow(10.0, 0.3 * (shift - 5.5))));
  for (double upper = shift - 4.5;; upper += 1) {
    const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (upper - 0.5)), upper_hz = 1000.0 * std::pow(10.0, 0.3 * upper);
    const bool last = upper_hz > 0.4 * static_cast<double>(sample_rate_hz);  // a narrow rest below half the rate is not a separate band
    octaves.centre_hz.push_back(static_cast<float>(centre_hz));
    octaves.edge_hz.push_back(last ? 0.5f * sample_rate_hz : static_cast<float>(upper_hz));
    if (last) return octaves;
  }
}

/// Magnitude of unit white noise per bin.  The two bins without a phase stay empty.
float magnitude_of(std::size_t bin, std::size_t num_bins) {
  return bin == 0 || bin + 1 == num_bins ? 0.f : std::sqrt(2.f * static_cast<float>(num_bins - 1));
}

/// One set of octaves with a flattener for each.
struct Octaves {
  Octaves(float sample_rate_hz, double shift, std::size_t num_channels, int length)
      : layout(flattening_octaves(sample_rate_hz, shift)), filters(layout, sample_rate_hz, length) {
    flatteners.reserve(static_cast<std::size_t>(layout.size()));
    for (int band = 0; band < layout.size(); ++band) {
      flatteners.emplace_back(num_channels, length, filters, band);
      if (static_cast<double>(layout.edge_hz[static_cast<std::size_t>(band) + 1]) < kLowHz * 1.5) num_low = band + 1;
    }
    sum.resize(filters.num_bins());
    while (num_low_bins < filters.num_bins() && (num_low_bins == 0 || filters.weight(num_low, num_low_bins) < 1.f)) ++num_low_bins;
  }

  BandLayout layout;
  BandFilters filters;
  std::vector<BandFlattener> flatteners;
  int num_low = 0;               ///< octaves that take part in the first passes
  std::size_t num_low_bins = 0;  ///< bins that they reach
  std::vector<Complex> sum;

  /// Flattens all octaves of the noise, or the lowest ones only; then every bin has the magnitude of white noise again.
  void pass(bool low_only, std::span<std::vector<Complex>> noise) {
    const int count = low_only ? num_low : filters.num_bands();
    tbb::parallel_for(0, count, [&](int band) {
      const FlushDenormals flush;
      flatteners[static_cast<std::size_t>(band)].flatten(noise);
    });
    for (std::vector<Complex>& channel : noise) {
      const auto c = static_cast<std::size_t>(&channel - noise.data());
      const std::size_t num_bins = channel.size(), used = low_only ? num_low_bins : num_bins;
      std::fill(sum.begin(), sum.end(), Complex{});
      for (int band = 0; band < count; ++band) flatteners[static_cast<std::size_t>(band)].add_to(c, sum);
      if (low_only)  // energy of the octave above stays; beyond it, nothing changes
        for (std::size_t k = 0; k < used; ++k) sum[k] += filters.weight(num_low, k) * channel[k];
      for (std::size_t k = 0; k < used; ++k) {
        const float size = std::abs(sum[k]), wanted = magnitude_of(k, num_bins);
        channel[k] = size > 0 ? sum[k] * (wanted / size) : Complex(wanted);
      }
    }
  }
};

/// White noise of the channels from `first_channel` on; spectra of exactly equal magnitude.
void make_plain_noise(int length, std::uint64_t seed, std::size_t first_channel, std::span<std::vector<Complex>> noise) {
  const auto num_bins = static_cast<std::size_t>(length / 2 + 1);
  for (std::size_t c = 0; c < noise.size(); ++c) {
    const RandomStream random(seed, Purpose::carrier, static_cast<std::uint32_t>(first_channel + c));
    noise[c].resize(num_bins);
    for (std::size_t k = 0; k < num_bins; ++k)
      noise[c][k] = Complex(std::polar(static_cast<double>(magnitude_of(k, num_bins)),
                                       2.0 * std::numbers::pi * static_cast<double>(random.uniform(static_cast<std::uint32_t>(k)))));
  }
}

/// The same flattened together.
void make_flat_noise(float sample_rate_hz, int length, std::uint64_t seed, std::size_t first_channel,
                     std::span<std::vector<Complex>> noise) {
  make_plain_noise(length, seed, first_channel, noise);
  std::array<Octaves, 2> octaves = {Octaves(sample_rate_hz, 0.0, noise.size(), length), Octaves(sample_rate_hz, 0.5, noise.size(), length)};
  for (int pass = 0; pass < kLowPasses + kPasses; ++pass) {
    Octaves& set = octaves[static_cast<std::size_t>((pass + 1) % 2)];
    set.pass(pass < kLowPasses, noise);
  }
}

}  // namespace

std::uint64_t carrier_key(std::uint64_t scene_hash, glm::vec3 source_position) {
  std::array<std::byte, sizeof scene_hash + sizeof source_position> identity;
  const auto scene = std::as_bytes(std::span(&scene_hash, 1)), position = std::as_bytes(std::span(&source_position, 1));
  std::ranges::copy(position, std::ranges::copy(scene, identity.begin()).out);
  return hash64(identity);
}

CarrierBank::CarrierBank(const BandLayout& bands, float sample_rate_hz, int num_channels, int length, std::uint64_t seed, CarrierKind kind)
    : length_(static_cast<std::size_t>(length)), num_channels_(num_channels) {
  require(num_channels >= 1 && num_channels <= kMaxChannels, "carrier channels", num_channels, "must be in [1, 256]");
  require(num_channels != 3 || kind == CarrierKind::plain, "carrier channels", num_channels,
          "must not be 3: channels are processed in twos or fours");
  const FlushDenormals flush;
  const auto channels = static_cast<std::size_t>(num_channels);
  std::vector<std::vector<Complex>> noise(channels);
  if (kind == CarrierKind::plain) {
    make_plain_noise(length, seed, kFirstPlainChannel, noise);
  } else {
    const std::size_t together = std::min(channels, BandFlattener::kMaxChannels);
    make_flat_noise(sample_rate_hz, length, seed, 0, std::span(noise).first(together));
    tbb::parallel_for(together, channels, [&](std::size_t c) {
      const FlushDenormals flush_worker;
      make_flat_noise(sample_rate_hz, length, seed, c, std::span(noise).subspan(c, 1));
    });
  }
  const BandFilters filters(bands, sample_rate_hz, length);
  forwards_.loops.resize(static_cast<std::size_t>(bands.size()) * channels * (length_ + kPad));
  tbb::parallel_for(0, bands.size(), [&](int band) {
    const FlushDenormals flush_worker;
    RealFft fft(length);
    std::vector<Complex> spectrum(filters.num_bins());
    for (std::size_t c = 0; c < channels; ++c) {
      for (std::size_t k = 0; k < spectrum.size(); ++k) spectrum[k] = filters.weight(band, k) * noise[c][k];
      const auto samples =
          std::span(forwards_.loops).subspan((static_cast<std::size_t>(band) * channels + c) * (length_ + kPad), length_ + kPad);
      fft.inverse(spectrum, samples.first(length_));
      for (std::size_t n = length_; n < samples.size(); ++n) samples[n] = samples[n - length_];
    }
  });
  if (kind == CarrierKind::flattened && channels > 1) make_kinds(bands.size());
}

void CarrierBank::make_kinds(int num_bands) {
  const std::size_t stride = length_ + kPad;
  backwards_.loops.resize(forwards_.loops.size());
  for (std::size_t begin = 0; begin < backwards_.loops.size(); begin += stride) {
    const auto backwards = std::span(backwards_.loops).subspan(begin, stride);
    std::ranges::reverse_copy(std::span(forwards_.loops).subspan(begin, length_), backwards.begin());
    for (std::size_t n = length_; n < stride; ++n) backwards[n] = backwards[n - length_];
  }
  if (num_channels_ < 4) return;
  for (Direction* direction : {&forwards_, &backwards_}) {
    for (int band = 0; band < num_bands; ++band) {
      for (const int in_bank : {0, 2}) {
        const auto loop = std::span(direction->loops).subspan(static_cast<std::size_t>(num_channels_ * band + in_bank) * stride, stride);
        std::ranges::transform(loop, std::back_inserter(direction->negative), [](float sample) { return -sample; });
      }
    }
  }
}

}  // namespace earshot
