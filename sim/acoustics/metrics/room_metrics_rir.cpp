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

}  // namespace

RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s) {
  require(!rir.empty(), "rir", rir.size(), "has no samples to measure");
  require(rir.size() <= (std::size_t{1} << 23), "rir", rir.size(), "is longer than 2^23 samples, a minute at 96 kHz and more");
  require(direct_delay_s >= 0, "direct_delay_s", direct_delay_s, "must not be negative");
  const BandLayout bands = BandLayout::octaves(sample_rate_hz);
  const double rate = sample_rate_hz;
  RoomMetrics metrics;
  metrics.bands_hz = bands.centre_hz;

  // Direct sound and the rest are filtered apart, so that the ringing of the direct sound does not count as reverberation.
  const auto size = static_cast<double>(rir.size());
  const auto split_at = [&](double time_s) { return static_cast<std::size_t>(std::clamp(std::round(time_s * rate), 0.0, size)); };
  const std::size_t direct_begin = split_at(direct_delay_s - kDirectWindowS), direct_end = split_at(direct_delay_s + kDirectWindowS);
  std::vector<float> direct(rir.size(), 0.f), rest(rir.begin(), rir.end());
  std::copy(rir.begin() + direct_begin, rir.begin() + direct_end, direct.begin() + direct_begin);
  std::fill(rest.begin() + direct_begin, rest.begin() + direct_end, 0.f);

  // Twice the length: the zero-phase ringing before time zero wraps to the end of the buffer and stays apart from the tail.
  const int fft_size = next_power_of_two(static_cast<int>(std::max<std::size_t>(2 * rir.size(), 4)));
  RealFft fft(fft_size);
  std::vector<std::complex<float>> direct_spectrum(fft.num_bins()), rest_spectrum(fft.num_bins()), filtered(fft.num_bins());
  fft.forward(direct, direct_spectrum);
  fft.forward(rest, rest_spectrum);
  std::vector<float> signal(fft_size), gain(fft.num_bins());

  const double start = direct_delay_s * rate;  // in samples
  const double bin_samples = kBinS * rate;
  const auto num_bins = static_cast<std::size_t>(std::max(1.0, std::ceil((size - start) / bin_samples)));
  for (int band = 0; band < bands.size(); ++band) {
    double delta_energy = 0;  // of a unit sample behind this filter: makes every band read in Green units
    for (int k = 0; k < fft.num_bins(); ++k) {
      gain[k] = static_cast<float>(octave_gain(bands, band, k * rate / fft_size, 0.5 * rate));
      delta_energy += (k == 0 || k == fft_size / 2 ? 1.0 : 2.0) * gain[k] * gain[k] / fft_size;
    }
    if (!(delta_energy > 0)) {
      metrics.bands.emplace_back();
      continue;
    }
    const auto filter = [&](const std::vector<std::complex<float>>& spectrum) {
      for (int k = 0; k < fft.num_bins(); ++k) filtered[k] = spectrum[k] * gain[k];
      fft.inverse(filtered, signal);
    };
    filter(direct_spectrum);
    const double direct_energy = energy_of(signal) / delta_energy;
    filter(rest_spectrum);
    std::vector<double> series(num_bins, 0.0);
    for (int i = 0; i < fft_size; ++i) {
      // The last quarter of the buffer is time before zero.
      const double sample = i < fft_size - fft_size / 4 ? i : i - fft_size;
      const double bin = std::max(0.0, (sample - start) / bin_samples);
      if (bin >= static_cast<double>(num_bins)) continue;  // ringing behind the end
      series[static_cast<std::size_t>(bin)] += double{signal[i]} * signal[i] / delta_energy;
    }
    metrics.bands.push_back(measure_band(series, kBinS, direct_energy));
  }

  const double direct_energy = energy_of(direct), rest_energy = energy_of(rest);
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
