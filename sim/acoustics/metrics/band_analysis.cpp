// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/band_analysis.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/metrics/octave_filter.h"
#include "sim/acoustics/metrics/signal_energy.h"

namespace earshot {
namespace {

constexpr double kDirectWindowS = 2.5e-3;

/// A response in two parts of its whole length.
struct SplitResponse {
  std::vector<float> direct, rest;
};
SplitResponse split_direct_sound(std::span<const float> rir, double rate, double direct_delay_s, bool has_direct) {
  const auto size = static_cast<double>(rir.size());
  const auto split_at = [&](double time_s) { return static_cast<std::size_t>(std::clamp(std::round(time_s * rate), 0.0, size)); };
  const std::size_t begin = split_at(direct_delay_s - kDirectWindowS), end = split_at(direct_delay_s + kDirectWindowS);
  SplitResponse split{std::vector<float>(rir.size(), 0.f), std::vector<float>(rir.begin(), rir.end())};
  if (!has_direct) return split;
  std::copy(rir.begin() + begin, rir.begin() + end, split.direct.begin() + begin);
  std::fill(split.rest.begin() + begin, split.rest.begin() + end, 0.f);
  return split;
}

/// Twice the length: the zero-phase ringing before time zero wraps to the end of the buffer and stays apart from the tail.
int fft_size_of(std::size_t samples) { return next_power_of_two(static_cast<int>(std::max<std::size_t>(2 * samples, 4))); }

}  // namespace

BandAnalysis::BandAnalysis(std::span<const float> rir, std::span<const float> lateral, const BandLayout& bands, double half_width,
                           double rate, double delay_s, bool has_direct)
    : bands_(bands),
      half_width_(half_width),
      rate_(rate),
      start_(delay_s * rate),
      num_bins_(static_cast<std::size_t>(std::max(1.0, std::ceil((static_cast<double>(rir.size()) - start_) / (kMeasuredBinS * rate))))),
      fft_(fft_size_of(rir.size())),
      direct_spectrum_(fft_.num_bins()),
      rest_spectrum_(fft_.num_bins()),
      filtered_(fft_.num_bins()),
      gain_(fft_.num_bins()) {
  const SplitResponse split = split_direct_sound(rir, rate, delay_s, has_direct);
  direct_energy_ = energy_of(split.direct), rest_energy_ = energy_of(split.rest);
  fft_.forward(split.direct, direct_spectrum_);
  fft_.forward(split.rest, rest_spectrum_);
  if (lateral.empty()) return;
  lateral_spectrum_.resize(rest_spectrum_.size());
  fft_.forward(lateral, lateral_spectrum_);
}

BandSignals BandAnalysis::filter_band(int band) {
  BandSignals signals;
  const double delta_energy = set_gain(band);
  if (!(delta_energy > 0)) return signals;
  const std::vector<float> direct = filtered(direct_spectrum_), rest = filtered(rest_spectrum_);
  signals.direct_energy = energy_of(direct) / delta_energy;
  signals.after_direct = series_of([&](std::size_t i) { return double{rest[i]} * rest[i]; }, delta_energy);
  const auto whole = [&](std::size_t i) { return double{direct[i]} + rest[i]; };
  signals.whole = series_of([&](std::size_t i) { return whole(i) * whole(i); }, delta_energy);
  if (lateral_spectrum_.empty()) return signals;
  const std::vector<float> lateral = filtered(lateral_spectrum_);
  signals.lateral = series_of([&](std::size_t i) { return double{lateral[i]} * lateral[i]; }, delta_energy);
  signals.product = series_of([&](std::size_t i) { return std::abs(whole(i) * double{lateral[i]}); }, delta_energy);
  return signals;
}

/// Sets the gains of a band and returns the energy of a unit sample behind its filter: makes every band read in Green units.
double BandAnalysis::set_gain(int band) {
  const int fft_size = fft_.size();
  double delta_energy = 0;
  for (int k = 0; k < fft_.num_bins(); ++k) {
    gain_[k] = static_cast<float>(octave_gain(bands_, band, k * rate_ / fft_size, 0.5 * rate_, half_width_));
    delta_energy += (k == 0 || k == fft_size / 2 ? 1.0 : 2.0) * gain_[k] * gain_[k] / fft_size;
  }
  return delta_energy;
}

std::vector<float> BandAnalysis::filtered(const Spectrum& spectrum) {
  for (int k = 0; k < fft_.num_bins(); ++k) filtered_[k] = spectrum[k] * gain_[k];
  std::vector<float> signal(fft_.size());
  fft_.inverse(filtered_, signal);
  return signal;
}

template <class Energy>
std::vector<double> BandAnalysis::series_of(const Energy& energy, double delta_energy) const {
  const int fft_size = fft_.size();
  const double bin_samples = kMeasuredBinS * rate_;
  std::vector<double> series(num_bins_, 0.0);
  for (int i = 0; i < fft_size; ++i) {
    // The last quarter of the buffer is time before zero.
    const double sample = i < fft_size - fft_size / 4 ? i : i - fft_size;
    const double bin = std::max(0.0, (sample - start_) / bin_samples);
    if (bin >= static_cast<double>(num_bins_)) continue;  // ringing behind the end
    series[static_cast<std::size_t>(bin)] += energy(static_cast<std::size_t>(i)) / delta_energy;
  }
  return series;
}

}  // namespace earshot
