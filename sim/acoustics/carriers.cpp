#include "sim/acoustics/carriers.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/band_filters.h"
#include "sim/audio/fft.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Makes one carrier at a time; owns the FFT and scratch.
class CarrierMaker {
 public:
  CarrierMaker(float sample_rate_hz, int length) : rate_hz_(sample_rate_hz), fft_(length), spectrum_(static_cast<std::size_t>(fft_.num_bins())), power_(static_cast<std::size_t>(length)) {}

  /// amplitude: of the band filter per bin.  bandwidth_hz: sets the smoothing of the local level.
  void make(std::span<const float> amplitude, float bandwidth_hz, const RandomStream& random, std::span<float> carrier) {
    for (std::size_t i = 0; i + 1 < carrier.size(); i += 2) {
      const auto pair = random.normal2(static_cast<std::uint32_t>(i / 2));
      carrier[i] = pair[0];
      carrier[i + 1] = pair[1];
    }
    filter(amplitude, carrier);
    for (int pass = 0; pass < 3; ++pass) {
      flatten(bandwidth_hz, carrier);
      filter(amplitude, carrier);
    }
    normalise(amplitude, carrier);
  }

 private:
  void filter(std::span<const float> amplitude, std::span<float> samples) {
    fft_.forward(samples, spectrum_);
    for (std::size_t k = 0; k < spectrum_.size(); ++k) spectrum_[k] *= amplitude[k];
    fft_.inverse(spectrum_, samples);
  }

  /// Divides by the local rms, smoothed with a Gaussian of standard deviation 1.5 / bandwidth (kappa = 1.5 of ORACLES 2.6: flat enough for a T20 and
  /// still noise to a short-time spectrum).
  void flatten(float bandwidth_hz, std::span<float> samples) {
    const double sigma_s = 1.5 / static_cast<double>(bandwidth_hz);
    for (std::size_t i = 0; i < samples.size(); ++i) power_[i] = samples[i] * samples[i];
    fft_.forward(power_, spectrum_);
    for (std::size_t k = 0; k < spectrum_.size(); ++k) {
      const double omega = 2 * std::numbers::pi * static_cast<double>(k) * static_cast<double>(rate_hz_) / static_cast<double>(samples.size());
      spectrum_[k] *= static_cast<float>(std::exp(-0.5 * omega * omega * sigma_s * sigma_s));
    }
    fft_.inverse(spectrum_, power_);
    double mean = 0;
    for (const float value : power_) mean += value;
    const float floor = static_cast<float>(1e-3 * mean / static_cast<double>(power_.size()));
    for (std::size_t i = 0; i < samples.size(); ++i) samples[i] /= std::sqrt(std::max(power_[i], floor));
  }

  /// Power of unit white noise behind the filter: the mean of its squared amplitude over frequency.
  void normalise(std::span<const float> amplitude, std::span<float> samples) const {
    double wanted = 0, power = 0;
    for (const float a : amplitude) wanted += static_cast<double>(a) * a;
    wanted /= static_cast<double>(amplitude.size());
    for (const float value : samples) power += static_cast<double>(value) * value;
    power /= static_cast<double>(samples.size());
    const float factor = power > 0 ? static_cast<float>(std::sqrt(wanted / power)) : 0.f;
    for (float& value : samples) value *= factor;
  }

  float rate_hz_;
  RealFft fft_;
  std::vector<std::complex<float>> spectrum_;
  std::vector<float> power_;
};

}  // namespace

CarrierBank::CarrierBank(const BandLayout& bands, float sample_rate_hz, int length, int num_channels, std::uint64_t seed)
    : length_(std::max(16384, next_power_of_two(length))), num_bands_(bands.size()), num_channels_(num_channels) {
  samples_.resize(static_cast<std::size_t>(length_) * static_cast<std::size_t>(num_bands_) * static_cast<std::size_t>(num_channels_));
  std::vector<float> amplitude = band_weights(bands, sample_rate_hz, length_);
  for (float& value : amplitude) value = std::sqrt(value);  // power-complementary: independent carriers add in power
  const std::size_t num_bins = static_cast<std::size_t>(length_ / 2 + 1);
  CarrierMaker maker(sample_rate_hz, length_);
  for (int channel = 0; channel < num_channels_; ++channel)
    for (int band = 0; band < num_bands_; ++band) {
      const auto b = static_cast<std::size_t>(band);
      const RandomStream random(seed, Purpose::carrier, static_cast<std::uint32_t>(channel), static_cast<std::uint32_t>(band));
      const float bandwidth_hz = bands.edge_hz[b + 1] - bands.edge_hz[b];
      const std::size_t first = (static_cast<std::size_t>(channel) * static_cast<std::size_t>(num_bands_) + b) * static_cast<std::size_t>(length_);
      maker.make(std::span(amplitude).subspan(b * num_bins, num_bins), bandwidth_hz, random, std::span(samples_).subspan(first, static_cast<std::size_t>(length_)));
    }
}

std::span<const float> CarrierBank::carrier(int channel, int band) const {
  const std::size_t index = static_cast<std::size_t>(channel) * static_cast<std::size_t>(num_bands_) + static_cast<std::size_t>(band);
  return std::span(samples_).subspan(index * static_cast<std::size_t>(length_), static_cast<std::size_t>(length_));
}

}  // namespace earshot
