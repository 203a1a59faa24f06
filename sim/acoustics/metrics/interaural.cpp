// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/interaural.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <vector>

#include "sim/acoustics/metrics/interaural_windows.h"
#include "sim/acoustics/metrics/octave_filter.h"
#include "sim/acoustics/metrics/signal_energy.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Points per sample at which the correlation is evaluated; a parabola through the largest finds the top between them.
constexpr int kPointsPerSample = 4;

std::vector<float> filtered(std::span<const float> samples, float sample_rate_hz, const BandLayout& bands, int band, double half_width) {
  // Twice the length: zero-phase ringing before the start wraps to the end and is cut off.
  RealFft fft(next_power_of_two(static_cast<int>(std::max<std::size_t>(2 * samples.size(), 4))));
  std::vector<Complex> spectrum(static_cast<std::size_t>(fft.num_bins()));
  fft.forward(samples, spectrum);
  for (std::size_t k = 0; k < spectrum.size(); ++k)
    spectrum[k] *= static_cast<float>(octave_gain(bands, band, static_cast<double>(k) * static_cast<double>(sample_rate_hz) / fft.size(),
                                                  0.5 * static_cast<double>(sample_rate_hz), half_width));
  std::vector<float> signal(static_cast<std::size_t>(fft.size()));
  fft.inverse(spectrum, signal);
  signal.resize(samples.size());
  return signal;
}

/// Largest |correlation| of two cuts, lags up to kMaxLagS.
std::optional<double> largest_correlation(std::span<const float> left, std::span<const float> right, double sample_rate_hz) {
  const double scale = std::sqrt(energy_of(left) * energy_of(right));
  if (!(scale > 0) || !std::isfinite(scale)) return std::nullopt;
  const int max_lag = static_cast<int>(std::ceil(kMaxLagS * sample_rate_hz)) * kPointsPerSample;
  const int size = next_power_of_two(static_cast<int>(left.size()) + max_lag / kPointsPerSample + 2);
  RealFft fft(std::max(size, 4)), fine(std::max(size, 4) * kPointsPerSample);
  std::vector<Complex> a(static_cast<std::size_t>(fft.num_bins())), b(a.size()), cross(static_cast<std::size_t>(fine.num_bins()));
  fft.forward(left, a);
  fft.forward(right, b);
  // A spectrum padded with zeros is the correlation at kPointsPerSample times the points.
  for (std::size_t k = 0; k < a.size(); ++k) cross[k] = static_cast<float>(kPointsPerSample) * std::conj(a[k]) * b[k];
  cross[a.size() - 1] *= 0.5f;  // the top bin stands for both signs of its frequency, which the longer spectrum holds apart
  std::vector<float> correlation(static_cast<std::size_t>(fine.size()));
  fine.inverse(cross, correlation);
  const auto at = [&](int lag) {
    return std::abs(static_cast<double>(correlation[static_cast<std::size_t>(lag < 0 ? lag + fine.size() : lag)]));
  };
  int best = 0;
  for (int lag = -max_lag; lag <= max_lag; ++lag)
    if (at(lag) > at(best)) best = lag;
  double top = at(best);
  if (std::abs(best) < max_lag) {
    const double before = at(best - 1), after = at(best + 1), curvature = before - 2.0 * top + after;
    if (curvature < 0) top -= 0.125 * (after - before) * (after - before) / curvature;
  }
  return std::min(top / scale, 1.0);
}

}  // namespace

InterauralCorrelation interaural_correlation(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s, int band) {
  return interaural_correlation(left, right, sample_rate_hz, direct_delay_s, BandLayout::octaves(sample_rate_hz), band, 0.25);
}

InterauralCorrelation interaural_correlation(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s, const BandLayout& bands, int band, double half_width) {
  require(left.size() == right.size() && !left.empty(), "samples of the right ear", right.size(),
          "must be as many as of the left ear, and at least one");
  require(left.size() <= (std::size_t{1} << 21), "rir", left.size(), "is longer than 2^21 samples");
  require(direct_delay_s >= 0, "direct_delay_s", direct_delay_s, "must not be negative");
  require(band >= -1 && band < bands.size(), "band", band, "must be -1 or a band of this sample rate");
  std::vector<float> of_left, of_right;
  if (band >= 0) {
    of_left = filtered(left, sample_rate_hz, bands, band, half_width);
    of_right = filtered(right, sample_rate_hz, bands, band, half_width);
    left = of_left, right = of_right;
  }
  const double rate = static_cast<double>(sample_rate_hz), size = static_cast<double>(left.size());
  const auto sample_at = [&](double time_s) { return static_cast<std::size_t>(std::clamp(std::round(time_s * rate), 0.0, size)); };
  const std::size_t begin = sample_at(direct_delay_s - kBeforeDirectS), limit = sample_at(direct_delay_s + kEarlyS);
  const auto between = [&](std::size_t from, std::size_t to) {
    return largest_correlation(left.subspan(from, to - from), right.subspan(from, to - from), rate);
  };
  return {between(begin, left.size()), between(begin, limit), between(limit, left.size())};
}

}  // namespace earshot
