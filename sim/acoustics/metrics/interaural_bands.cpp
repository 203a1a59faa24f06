// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/interaural_bands.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/metrics/interaural_windows.h"
#include "sim/acoustics/metrics/octave_filter.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kHighestItdHz = 1200;  ///< of the centre: the octave of 1 kHz is the last
constexpr double kPointsPerPeriod = 8;  ///< of the correlation, at the upper edge of a band

/// Two ears in one window, as spectra.
struct EarSpectra {
  int size;
  std::vector<std::complex<float>> left, right;

  EarSpectra(std::span<const float> of_left, std::span<const float> of_right) {
    RealFft fft(std::max(next_power_of_two(static_cast<int>(2 * of_left.size())), 4));
    size = fft.size();
    left.resize(static_cast<std::size_t>(fft.num_bins()));
    right.resize(left.size());
    fft.forward(of_left, left);
    fft.forward(of_right, right);
  }
};

/// Cross-correlation of one band for lags from -kMaxLagS to kMaxLagS, step_s apart, and the energies of both ears.
struct BandCorrelation {
  double left = 0, right = 0, step_s = 0;
  std::vector<double> at_lag;
  [[nodiscard]] bool heard() const { return left > 0 && right > 0 && std::isfinite(left) && std::isfinite(right); }
};

BandCorrelation correlate(const EarSpectra& ears, const BandLayout& bands, int band, double rate_hz) {
  const double hz_per_bin = rate_hz / ears.size, nyquist_hz = 0.5 * rate_hz;
  // The slopes of the filter reach a quarter of an octave beyond the edges (octave_filter.h).
  const double beyond = std::exp2(0.25);
  const double low_hz = double{bands.edge_hz[static_cast<std::size_t>(band)]} / beyond;
  const double high_hz = std::min(double{bands.edge_hz[static_cast<std::size_t>(band) + 1]} * beyond, nyquist_hz);
  const auto first = static_cast<std::size_t>(low_hz / hz_per_bin), last = static_cast<std::size_t>(high_hz / hz_per_bin);
  const auto steps = static_cast<int>(std::ceil(kMaxLagS * kPointsPerPeriod * high_hz));  // on either side of 0
  BandCorrelation correlation;
  correlation.step_s = kMaxLagS / steps;
  correlation.at_lag.assign(static_cast<std::size_t>(2 * steps + 1), 0.0);
  for (std::size_t k = first; k <= last && k + 1 < ears.left.size(); ++k) {
    const double hz = static_cast<double>(k) * hz_per_bin, gain = octave_gain(bands, band, hz, nyquist_hz);
    if (!(gain > 0)) continue;
    const std::complex<double> left(ears.left[k]), right(ears.right[k]);
    correlation.left += gain * gain * std::norm(left);
    correlation.right += gain * gain * std::norm(right);
    // sum over t of left(t) right(t + lag) is the inverse transform of conj(left) right.
    const double turn = 2 * std::numbers::pi * hz;
    const std::complex<double> step = std::polar(1.0, turn * correlation.step_s);
    std::complex<double> term = gain * gain * std::conj(left) * right * std::polar(1.0, -turn * kMaxLagS);
    for (double& sum : correlation.at_lag) {
      sum += term.real();
      term = {term.real() * step.real() - term.imag() * step.imag(), term.real() * step.imag() + term.imag() * step.real()};
    }
  }
  return correlation;
}

struct Peak {
  double lag_s, value;
};

/// Largest of size(value at a lag), with a parabola through its neighbours.
template <class Size>
Peak peak_of(const BandCorrelation& correlation, const Size& size) {
  const std::vector<double>& values = correlation.at_lag;
  std::size_t best = 0;
  for (std::size_t i = 1; i < values.size(); ++i)
    if (size(values[i]) > size(values[best])) best = i;
  Peak peak{static_cast<double>(best) * correlation.step_s - kMaxLagS, size(values[best])};
  if (best == 0 || best + 1 == values.size()) return peak;
  const double before = size(values[best - 1]), after = size(values[best + 1]), curvature = before - 2 * peak.value + after;
  if (!(curvature < 0)) return peak;
  peak.lag_s -= 0.5 * correlation.step_s * (after - before) / curvature;
  peak.value -= 0.125 * (after - before) * (after - before) / curvature;
  return peak;
}

}  // namespace

std::vector<InterauralBand> interaural_bands(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s) {
  require(left.size() == right.size() && !left.empty(), "samples of the right ear", right.size(),
          "must be as many as of the left ear, and at least one");
  require(left.size() <= (std::size_t{1} << 21), "rir", left.size(), "is longer than 2^21 samples");
  require(direct_delay_s >= 0, "direct_delay_s", direct_delay_s, "must not be negative");
  const BandLayout bands = BandLayout::octaves(sample_rate_hz);
  const double rate = sample_rate_hz, samples = static_cast<double>(left.size());
  const auto sample_at = [&](double time_s) { return static_cast<std::size_t>(std::clamp(std::round(time_s * rate), 0.0, samples)); };
  const std::size_t begin = sample_at(direct_delay_s - kBeforeDirectS), early_end = sample_at(direct_delay_s + kEarlyS);
  std::vector<InterauralBand> result(static_cast<std::size_t>(bands.size()));
  if (begin >= early_end) return result;
  const EarSpectra whole(left.subspan(begin), right.subspan(begin));
  const EarSpectra early(left.subspan(begin, early_end - begin), right.subspan(begin, early_end - begin));
  for (int band = 0; band < bands.size(); ++band) {
    InterauralBand& of_band = result[static_cast<std::size_t>(band)];
    const BandCorrelation all = correlate(whole, bands, band, rate);
    if (all.heard()) {
      of_band.ild_db = 10 * std::log10(all.left / all.right);
      const Peak peak = peak_of(all, [](double value) { return std::abs(value); });
      of_band.iacc = std::min(peak.value / std::sqrt(all.left * all.right), 1.0);
    }
    if (double{bands.centre_hz[static_cast<std::size_t>(band)]} > kHighestItdHz) continue;
    const BandCorrelation first = correlate(early, bands, band, rate);
    if (first.heard()) of_band.itd_s = peak_of(first, [](double value) { return value; }).lag_s;
  }
  return result;
}

}  // namespace earshot
