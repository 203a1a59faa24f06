// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/noise_tail.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace earshot {
namespace {

constexpr double kShortestS = 0.2, kFirstIntervalS = 0.01;
constexpr double kAboveNoiseDb = 5.0, kFitSpanDb = 20.0, kIntervalsPerDecade = 4.0, kLeastRangeDb = 15.0, kBelowCrossingDb = 8.0;
constexpr int kRounds = 6;

double decibels(double energy) { return energy > 0 ? 10.0 * std::log10(energy) : -std::numeric_limits<double>::infinity(); }

double mean_of(std::span<const double> values) {
  return values.empty() ? 0.0 : std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Level over bins.
struct Line {
  double at_zero_db = 0, db_per_bin = 0;
  [[nodiscard]] double at(double bin) const { return at_zero_db + db_per_bin * bin; }
  [[nodiscard]] double crossing(double level_db) const { return (level_db - at_zero_db) / db_per_bin; }
};

/// Mean energies of equal intervals.
struct Smoothed {
  std::vector<double> level_db;
  double bins_each = 1;
  [[nodiscard]] double middle(std::size_t i) const { return (static_cast<double>(i) + 0.5) * bins_each - 0.5; }
};

Smoothed smooth(std::span<const double> energy, std::size_t bins_each) {
  Smoothed smoothed{.level_db = {}, .bins_each = static_cast<double>(bins_each)};
  for (std::size_t i = 0; i + bins_each <= energy.size(); i += bins_each)
    smoothed.level_db.push_back(decibels(mean_of(energy.subspan(i, bins_each))));
  return smoothed;
}

/// Least squares through the intervals from `first` on, from the first one at or below `from_db` to the last one before one below `to_db`.
std::optional<Line> fit_line(const Smoothed& smoothed, std::size_t first, double from_db, double to_db) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = first; i < smoothed.level_db.size(); ++i) {
    const double level_db = smoothed.level_db[i];
    if (level_db > from_db) continue;
    if (level_db < to_db) break;
    const double bin = smoothed.middle(i);
    n += 1, x += bin, y += level_db, xx += bin * bin, xy += bin * level_db;
  }
  const double spread = n * xx - x * x;
  if (n < 3 || !(spread > 0)) return std::nullopt;
  Line line;
  line.db_per_bin = (n * xy - x * y) / spread;
  line.at_zero_db = (y - line.db_per_bin * x) / n;
  return line.db_per_bin < 0 && std::isfinite(line.at_zero_db) ? std::optional(line) : std::nullopt;
}

std::size_t loudest_of(const Smoothed& smoothed) {
  return static_cast<std::size_t>(std::ranges::max_element(smoothed.level_db) - smoothed.level_db.begin());
}

}  // namespace

std::optional<NoiseCut> find_noise(std::span<const double> energy, double bin_s) {
  const std::size_t tenth = energy.size() / 10;
  if (static_cast<double>(energy.size()) * bin_s < kShortestS || tenth == 0) return std::nullopt;
  double noise = mean_of(energy.last(tenth));
  if (!(noise > 0)) return std::nullopt;
  Smoothed smoothed = smooth(energy, std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(kFirstIntervalS / bin_s))));
  const double loudest_db = smoothed.level_db[loudest_of(smoothed)];
  std::optional<Line> line =
      fit_line(smoothed, loudest_of(smoothed), std::numeric_limits<double>::infinity(), decibels(noise) + kAboveNoiseDb);
  if (!line) return std::nullopt;
  const auto bins = static_cast<double>(energy.size());
  double crossing = std::clamp(line->crossing(decibels(noise)), 0.0, bins);
  for (int round = 0; round < kRounds; ++round) {
    const double each = std::clamp(-10.0 / line->db_per_bin / kIntervalsPerDecade, 1.0, bins / 10);
    smoothed = smooth(energy, static_cast<std::size_t>(each));
    const double from = std::min(crossing - kBelowCrossingDb / line->db_per_bin, bins - static_cast<double>(tenth));
    noise = mean_of(energy.subspan(static_cast<std::size_t>(std::max(from, 0.0))));
    if (!(noise > 0)) return std::nullopt;
    const double low_db = decibels(noise) + kAboveNoiseDb;
    line = fit_line(smoothed, loudest_of(smoothed), low_db + kFitSpanDb, low_db);
    if (!line) return std::nullopt;
    const double before = crossing;
    crossing = std::clamp(line->crossing(decibels(noise)), 0.0, bins);
    if (std::abs(crossing - before) < 1.0) break;
  }
  if (loudest_db - decibels(noise) < kLeastRangeDb || crossing >= bins - static_cast<double>(tenth)) return std::nullopt;
  const auto bin = static_cast<std::size_t>(crossing);
  return NoiseCut{.bin = bin,
                  .noise = noise,
                  .energy_per_bin = std::pow(10.0, 0.1 * line->at(static_cast<double>(bin))),
                  .ratio_per_bin = std::pow(10.0, 0.1 * line->db_per_bin)};
}

void replace_noise(const NoiseCut& cut, std::span<double> energy) {
  double level = cut.energy_per_bin;
  for (std::size_t i = cut.bin; i < energy.size(); ++i, level *= cut.ratio_per_bin) energy[i] = level;
}

}  // namespace earshot
