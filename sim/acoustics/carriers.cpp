#include "sim/acoustics/carriers.h"

#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/band_filters.h"
#include "sim/audio/fft.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

constexpr std::size_t kMaxChannels = 4;
/// Standard deviation of the Gaussian window of the local covariance, in inverse bandwidths.
constexpr double kWindowBandwidths = 1.2;
/// Even passes flatten octaves, odd ones octaves half an octave higher: any octave is then flat.
constexpr int kPasses = 12;
/// Keeps the local covariance invertible, relative to its mean.
constexpr float kRegularization = 1e-3f;

template <class T>
using PerChannel = std::array<T, kMaxChannels>;
using Spectra = PerChannel<std::vector<Complex>>;
using Signals = PerChannel<std::vector<float>>;

/// Octaves from about 30 Hz up to half the rate, independent of the bands of a response.  Those below 125 Hz keep what lies under the
/// lowest octave that is measured from unsettling it.  shift: 0 for the usual midbands, 0.5 for octaves that straddle their edges.
BandLayout flattening_octaves(float sample_rate_hz, double shift) {
  BandLayout octaves;
  octaves.edge_hz.push_back(static_cast<float>(1000.0 * std::pow(10.0, 0.3 * (shift - 5.5))));
  for (double upper = shift - 4.5;; upper += 1) {
    const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (upper - 0.5)), upper_hz = 1000.0 * std::pow(10.0, 0.3 * upper);
    const bool last = upper_hz > 0.4 * static_cast<double>(sample_rate_hz);  // a sliver below half the rate is no band of its own
    octaves.centre_hz.push_back(static_cast<float>(centre_hz));
    octaves.edge_hz.push_back(last ? 0.5f * sample_rate_hz : static_cast<float>(upper_hz));
    if (last) return octaves;
  }
}

/// One band of all channels while it is flattened.  Owns its scratch: one per task.
class BandFlattener {
 public:
  BandFlattener(std::size_t num_channels, int length)
      : num_channels_(num_channels),
        length_(static_cast<std::size_t>(length)),
        fft_(length),
        plane_(length_),
        bins_(static_cast<std::size_t>(fft_.num_bins())),
        smoothing_(bins_.size()) {
    for (std::size_t c = 0; c < num_channels_; ++c) signal_[c].resize(length_);
    for (std::size_t i = 0; i < num_channels_; ++i)
      for (std::size_t j = 0; j < num_channels_; ++j) covariance_[i][j].resize(length_);
  }

  /// Writes the band `band` of `noise` with its local covariance made the identity.
  void flatten(const Spectra& noise, const BandFilters& filters, int band, Signals& flat) {
    double share = 0;  // of the bandwidth, which is half a cycle per sample
    for (std::size_t k = 0; k < bins_.size(); ++k) share += static_cast<double>(filters.share(band, k)) / static_cast<double>(bins_.size());
    const double sigma = kWindowBandwidths / (0.5 * share);
    for (std::size_t k = 0; k < bins_.size(); ++k) {
      const double x = 2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(length_) * sigma;
      smoothing_[k] = static_cast<float>(std::exp(-0.5 * x * x));
    }
    for (std::size_t c = 0; c < num_channels_; ++c) cut_band(noise[c], filters, band, signal_[c]);
    measure_covariance();
    for (std::size_t n = 0; n < length_; ++n) whiten(n);
    const auto scale = static_cast<float>(std::sqrt(2.0 * share));  // analytic signals have twice the power of the band
    for (std::size_t c = 0; c < num_channels_; ++c)
      for (std::size_t n = 0; n < length_; ++n) flat[c][n] = scale * signal_[c][n].real();
  }

 private:
  /// The band and its Hilbert transform as one complex signal.
  void cut_band(const std::vector<Complex>& spectrum, const BandFilters& filters, int band, std::vector<Complex>& signal) {
    for (std::size_t k = 0; k < bins_.size(); ++k) bins_[k] = filters.share(band, k) * spectrum[k];
    fft_.inverse(bins_, plane_);
    for (std::size_t n = 0; n < length_; ++n) signal[n] = plane_[n];
    for (Complex& bin : bins_) bin = {bin.imag(), -bin.real()};  // times -i
    fft_.inverse(bins_, plane_);
    for (std::size_t n = 0; n < length_; ++n) signal[n].imag(plane_[n]);
  }

  void smooth(std::vector<float>& values) {
    fft_.forward(values, bins_);
    for (std::size_t k = 0; k < bins_.size(); ++k) bins_[k] *= smoothing_[k];
    fft_.inverse(bins_, values);
  }

  /// Local Hermitian covariance: real parts in the lower triangle and the diagonal, imaginary parts of (i, j), i > j, in (j, i).
  void measure_covariance() {
    for (std::size_t i = 0; i < num_channels_; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        for (std::size_t n = 0; n < length_; ++n) {
          const Complex a = signal_[i][n], b = signal_[j][n];
          covariance_[i][j][n] = a.real() * b.real() + a.imag() * b.imag();
          if (i != j) covariance_[j][i][n] = a.imag() * b.real() - a.real() * b.imag();
        }
        smooth(covariance_[i][j]);
        if (i != j) smooth(covariance_[j][i]);
      }
    }
  }

  /// Multiplies the channels at sample n by the inverse Cholesky factor of their covariance: channel 0 is only rescaled, each further
  /// channel loses what it locally shares with those before it.  So channel 0 is the same for every number of channels.
  void whiten(std::size_t n) {
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

  std::size_t num_channels_, length_;
  RealFft fft_;
  std::vector<float> plane_;
  std::vector<Complex> bins_;
  std::vector<float> smoothing_;
  PerChannel<std::vector<Complex>> signal_;
  PerChannel<PerChannel<std::vector<float>>> covariance_;
};

/// Magnitude of unit white noise per bin.  The two bins without a phase stay empty.
float magnitude_of(std::size_t bin, std::size_t num_bins) {
  return bin == 0 || bin + 1 == num_bins ? 0.f : std::sqrt(2.f * static_cast<float>(num_bins - 1));
}

/// White noise of `num_channels` channels, flattened in octaves; spectra of exactly equal magnitude.
Spectra make_noise(float sample_rate_hz, std::size_t num_channels, int length, std::uint64_t seed) {
  const auto num_bins = static_cast<std::size_t>(length / 2 + 1);
  Spectra noise;
  for (std::size_t c = 0; c < num_channels; ++c) {
    const RandomStream random(seed, Purpose::carrier, static_cast<std::uint32_t>(c));
    noise[c].resize(num_bins);
    for (std::size_t k = 0; k < num_bins; ++k)
      noise[c][k] = Complex(std::polar(static_cast<double>(magnitude_of(k, num_bins)),
                                       2.0 * std::numbers::pi * static_cast<double>(random.uniform(static_cast<std::uint32_t>(k)))));
  }
  const BandFilters filters[2] = {BandFilters(flattening_octaves(sample_rate_hz, 0.0), sample_rate_hz, length),
                                  BandFilters(flattening_octaves(sample_rate_hz, 0.5), sample_rate_hz, length)};
  const auto max_bands = static_cast<std::size_t>(std::max(filters[0].num_bands(), filters[1].num_bands()));
  std::vector<Signals> flat(max_bands);
  for (Signals& signals : flat)
    for (std::size_t c = 0; c < num_channels; ++c) signals[c].resize(static_cast<std::size_t>(length));
  for (int pass = 0; pass < kPasses; ++pass) {
    const BandFilters& bands = filters[(pass + 1) % 2];
    tbb::parallel_for(0, bands.num_bands(), [&](int band) {
      BandFlattener(num_channels, length).flatten(noise, bands, band, flat[static_cast<std::size_t>(band)]);
    });
    tbb::parallel_for(std::size_t{0}, num_channels, [&](std::size_t c) {
      for (std::size_t band = 1; band < static_cast<std::size_t>(bands.num_bands()); ++band)
        for (std::size_t n = 0; n < flat[0][c].size(); ++n) flat[0][c][n] += flat[band][c][n];
      RealFft fft(length);
      fft.forward(flat[0][c], noise[c]);
      for (std::size_t k = 0; k < num_bins; ++k) {
        const float size = std::abs(noise[c][k]), wanted = magnitude_of(k, num_bins);
        noise[c][k] = size > 0 ? noise[c][k] * (wanted / size) : Complex(wanted);
      }
    });
  }
  return noise;
}

}  // namespace

CarrierBank::CarrierBank(const BandLayout& bands, float sample_rate_hz, int num_channels, int length, std::uint64_t seed)
    : length_(static_cast<std::size_t>(length)), num_channels_(num_channels) {
  require(num_channels >= 1 && num_channels <= static_cast<int>(kMaxChannels), "carrier channels", num_channels, "must be in [1, 4]");
  const auto channels = static_cast<std::size_t>(num_channels);
  const Spectra noise = make_noise(sample_rate_hz, channels, length, seed);
  const BandFilters filters(bands, sample_rate_hz, length);
  samples_.resize(static_cast<std::size_t>(bands.size()) * channels * length_);
  tbb::parallel_for(0, bands.size(), [&](int band) {
    RealFft fft(length);
    std::vector<Complex> spectrum(filters.num_bins());
    for (std::size_t c = 0; c < channels; ++c) {
      for (std::size_t k = 0; k < spectrum.size(); ++k) spectrum[k] = filters.share(band, k) * noise[c][k];
      fft.inverse(spectrum, std::span(samples_).subspan((static_cast<std::size_t>(band) * channels + c) * length_, length_));
    }
  });
}

}  // namespace earshot
