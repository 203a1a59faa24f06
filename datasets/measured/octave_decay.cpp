// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/octave_decay.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/metrics/band_analysis.h"
#include "sim/acoustics/metrics/noise_tail.h"
#include "sim/acoustics/metrics/onset.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kLowestLevelDb = -80, kHalfWidthOctaves = 0.25;

std::vector<double> decay_curve_db(std::span<const double> energy) {
  std::vector<double> left(energy.size()), level_db;
  energy_decay_curve(energy, left);
  for (const double value : left) {
    const double db = value > 0 ? 10 * std::log10(value / left.front()) : kLowestLevelDb;
    if (db <= kLowestLevelDb) break;
    level_db.push_back(db);
  }
  return level_db;
}

void add(std::span<const double> from, double weight, std::vector<double>& to) {
  to.resize(std::max(to.size(), from.size()), 0.0);
  for (std::size_t i = 0; i < from.size(); ++i) to[i] += weight * from[i];
}

std::vector<OctaveDecay> mean_decays(std::span<const std::span<const float>> records, double rate, double start_s) {
  require(rate >= 1000, "sample rate", rate, "must be at least 1000 Hz");
  const BandLayout bands = BandLayout::octaves(static_cast<float>(rate));
  std::vector<BandAnalysis> analyses;
  analyses.reserve(records.size());
  for (const std::span<const float> record : records)
    analyses.emplace_back(record, std::span<const float>{}, bands, kHalfWidthOctaves, rate, start_s);
  std::vector<OctaveDecay> decays;
  for (int band = 0; band < bands.size(); ++band) {
    const double centre_hz = bands.centre_hz[static_cast<std::size_t>(band)];
    if (centre_hz < kLowestComparedHz || centre_hz > kHighestComparedHz) continue;
    BandSignals mean;
    for (BandAnalysis& analysis : analyses) {
      const BandSignals signals = analysis.filter_band(band);
      const double weight = 1.0 / static_cast<double>(records.size());
      mean.direct_energy += weight * signals.direct_energy;
      add(signals.after_direct, weight, mean.after_direct);
      add(signals.whole, weight, mean.whole);
    }
    if (mean.whole.empty()) continue;
    if (const auto cut = find_noise(mean.whole, kMeasuredBinS)) {
      replace_noise(*cut, mean.whole);
      replace_noise(*cut, mean.after_direct);
    }
    decays.push_back({.centre_hz = centre_hz,
                      .metrics = measure_band(mean.after_direct, kMeasuredBinS, mean.direct_energy, mean.whole),
                      .level_db = decay_curve_db(mean.whole)});
  }
  return decays;
}

}  // namespace

std::vector<OctaveDecay> octave_decays(std::span<const float> samples, float sample_rate_hz, std::optional<double> direct_delay_s) {
  const double rate = sample_rate_hz;
  const double start_s = direct_delay_s ? *direct_delay_s : static_cast<double>(find_onset(samples, rate).value_or(0)) / rate;
  return mean_decays(std::span(&samples, 1), rate, start_s);
}

std::vector<OctaveDecay> octave_decays(std::span<const std::vector<float>> records, float sample_rate_hz, double direct_delay_s) {
  const std::vector<std::span<const float>> spans(records.begin(), records.end());
  return mean_decays(spans, sample_rate_hz, direct_delay_s);
}

}  // namespace earshot
