// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <complex>

#include "sim/acoustics/metrics/interaural.h"
#include "sim/acoustics/metrics/octave_filter.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/metrics/signal_energy.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kDirectWindowS = 2.5e-3;
constexpr double kBinS = 1e-3;
/// Of minutes of response the first 20 s and more decide: the rest is 20 dB and more below, or noise.
constexpr std::size_t kMaxInterauralSamples = std::size_t{1} << 21;

/// A response in two parts of its whole length.  They are filtered apart, so that the ringing of the direct sound does not count as
/// reverberation.
struct SplitResponse {
  std::vector<float> direct, rest;
};
SplitResponse split_direct_sound(std::span<const float> rir, double rate, double direct_delay_s) {
  const auto size = static_cast<double>(rir.size());
  const auto split_at = [&](double time_s) { return static_cast<std::size_t>(std::clamp(std::round(time_s * rate), 0.0, size)); };
  const std::size_t begin = split_at(direct_delay_s - kDirectWindowS), end = split_at(direct_delay_s + kDirectWindowS);
  SplitResponse split{std::vector<float>(rir.size(), 0.f), std::vector<float>(rir.begin(), rir.end())};
  std::copy(rir.begin() + begin, rir.begin() + end, split.direct.begin() + begin);
  std::fill(split.rest.begin() + begin, split.rest.begin() + end, 0.f);
  return split;
}

/// Measures a split response octave by octave.
class OctaveAnalysis {
 public:
  /// start: time zero, in samples.
  OctaveAnalysis(const SplitResponse& split, const BandLayout& bands, double rate, double start)
      : bands_(bands),
        rate_(rate),
        start_(start),
        num_bins_(static_cast<std::size_t>(std::max(1.0, std::ceil((static_cast<double>(split.rest.size()) - start) / (kBinS * rate))))),
        // Twice the length: the zero-phase ringing before time zero wraps to the end of the buffer and stays apart from the tail.
        fft_(next_power_of_two(static_cast<int>(std::max<std::size_t>(2 * split.rest.size(), 4)))),
        direct_spectrum_(fft_.num_bins()),
        rest_spectrum_(fft_.num_bins()),
        filtered_(fft_.num_bins()),
        signal_(fft_.size()),
        gain_(fft_.num_bins()) {
    fft_.forward(split.direct, direct_spectrum_);
    fft_.forward(split.rest, rest_spectrum_);
  }

  BandMetrics measure_octave(int band) {
    const double delta_energy = set_gain(band);
    if (!(delta_energy > 0)) return {};
    filter(direct_spectrum_);
    const double direct_energy = energy_of(signal_) / delta_energy;
    filter(rest_spectrum_);
    return measure_band(series_of_signal(delta_energy), kBinS, direct_energy);
  }

 private:
  /// Energy of a unit sample behind the filter of a band: makes every band read in Green units.
  double set_gain(int band) {
    const int fft_size = fft_.size();
    double delta_energy = 0;
    for (int k = 0; k < fft_.num_bins(); ++k) {
      gain_[k] = static_cast<float>(octave_gain(bands_, band, k * rate_ / fft_size, 0.5 * rate_));
      delta_energy += (k == 0 || k == fft_size / 2 ? 1.0 : 2.0) * gain_[k] * gain_[k] / fft_size;
    }
    return delta_energy;
  }
  /// Writes a spectrum behind the filter to signal_.
  void filter(const std::vector<std::complex<float>>& spectrum) {
    for (int k = 0; k < fft_.num_bins(); ++k) filtered_[k] = spectrum[k] * gain_[k];
    fft_.inverse(filtered_, signal_);
  }
  [[nodiscard]] std::vector<double> series_of_signal(double delta_energy) const {
    const int fft_size = fft_.size();
    const double bin_samples = kBinS * rate_;
    std::vector<double> series(num_bins_, 0.0);
    for (int i = 0; i < fft_size; ++i) {
      // The last quarter of the buffer is time before zero.
      const double sample = i < fft_size - fft_size / 4 ? i : i - fft_size;
      const double bin = std::max(0.0, (sample - start_) / bin_samples);
      if (bin >= static_cast<double>(num_bins_)) continue;  // ringing behind the end
      series[static_cast<std::size_t>(bin)] += double{signal_[i]} * signal_[i] / delta_energy;
    }
    return series;
  }

  const BandLayout& bands_;
  double rate_, start_;
  std::size_t num_bins_;
  RealFft fft_;
  std::vector<std::complex<float>> direct_spectrum_, rest_spectrum_, filtered_;
  std::vector<float> signal_, gain_;
};

}  // namespace

RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s) {
  require(!rir.empty(), "rir", rir.size(), "has no samples to measure");
  require(rir.size() <= (std::size_t{1} << 23), "rir", rir.size(), "is longer than 2^23 samples");
  require(direct_delay_s >= 0, "direct_delay_s", direct_delay_s, "must not be negative");
  const BandLayout bands = BandLayout::octaves(sample_rate_hz);
  const double rate = sample_rate_hz;
  RoomMetrics metrics;
  metrics.bands_hz = bands.centre_hz;
  const SplitResponse split = split_direct_sound(rir, rate, direct_delay_s);
  OctaveAnalysis analysis(split, bands, rate, direct_delay_s * rate);
  for (int band = 0; band < bands.size(); ++band) metrics.bands.push_back(analysis.measure_octave(band));

  const double direct_energy = energy_of(split.direct), rest_energy = energy_of(split.rest);
  if (direct_energy > 0) {
    metrics.direct_delay_s = direct_delay_s;
    metrics.direct_amplitude = std::sqrt(direct_energy);
    if (rest_energy > 0) metrics.drr_db = 10.0 * std::log10(direct_energy / rest_energy);
  }
  return metrics;
}

RoomMetrics measure(const Rir& rir, double direct_delay_s) {
  require(rir.num_channels >= 1, "channels", rir.num_channels, "must be at least one");
  RoomMetrics metrics = measure(rir.channel(0), rir.sample_rate_hz, direct_delay_s);
  if (rir.num_channels != 2) return metrics;
  const BandLayout bands = BandLayout::octaves(rir.sample_rate_hz);
  for (int band = 0; band < bands.size(); ++band) {
    const std::size_t heard = std::min<std::size_t>(rir.channel(0).size(), kMaxInterauralSamples);
    const InterauralCorrelation iacc =
        interaural_correlation(rir.channel(0).first(heard), rir.channel(1).first(heard), rir.sample_rate_hz, direct_delay_s, band);
    BandMetrics& of_band = metrics.bands[static_cast<std::size_t>(band)];
    of_band.iacc = iacc.total, of_band.iacc_early = iacc.early, of_band.iacc_late = iacc.late;
  }
  return metrics;
}

}  // namespace earshot
