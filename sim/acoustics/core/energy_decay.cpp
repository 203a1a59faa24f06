// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/energy_decay.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "sim/acoustics/core/missing_energy.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kSilent = -std::numeric_limits<double>::infinity();

double decibels(double ratio) { return ratio > 0 ? 10.0 * std::log10(ratio) : kSilent; }

/// Decay curve in dB at bin edges: level[i] at time i * bin_s.  The last edge is silent.
struct DecayCurve {
  std::vector<double> level_db;
  double bin_s;

  [[nodiscard]] double at(double time_s) const {
    const double position = std::clamp(time_s / bin_s, 0.0, static_cast<double>(level_db.size() - 1));
    const auto i = std::min(static_cast<std::size_t>(position), level_db.size() - 2);
    const double w = position - static_cast<double>(i);
    return w == 0 ? level_db[i] : level_db[i] + w * (level_db[i + 1] - level_db[i]);
  }

  /// First time at which the curve falls to `target_db`, interpolated; nullopt if it never does before silence.
  [[nodiscard]] std::optional<double> crossing(double target_db) const {
    for (std::size_t i = 0; i < level_db.size(); ++i) {
      if (level_db[i] > target_db) continue;
      if (i == 0) return 0.0;
      const double above = level_db[i - 1], below = level_db[i];
      if (below == kSilent) return std::nullopt;  // fell off the end: nothing to interpolate with
      return bin_s * (static_cast<double>(i - 1) + (above - target_db) / (above - below));
    }
    return std::nullopt;
  }
};

/// Decay time of the least-squares line through the straight segments of the curve between two levels.
std::optional<double> fit_decay_time(const DecayCurve& curve, double from_db, double to_db) {
  const auto begin = curve.crossing(from_db), end = curve.crossing(to_db);
  if (!begin || !end || !(*end > *begin)) return std::nullopt;
  // At least three points of the curve: two crossings and an edge between them.
  if (std::floor(*end / curve.bin_s) - std::floor(*begin / curve.bin_s) < 1) return std::nullopt;

  // Minimise the integral of (L(t) - a - b u)^2 with u = t - mid: b = int(L u) / int(u^2), by segments.  With u = m + x and
  // L = l + g x about the middle of a segment of width h: int(L u) = h l m + g h^3 / 12.
  const double mid = 0.5 * (*begin + *end), span = *end - *begin;
  double product = 0;
  for (double left = *begin; left < *end;) {
    double right = std::min((std::floor(left / curve.bin_s + 1e-9) + 1) * curve.bin_s, *end);
    if (*end - right < 1e-9 * curve.bin_s) right = *end;
    const double width = right - left;
    const double low = curve.at(left), high = curve.at(right);
    product += 0.5 * (low + high) * width * (0.5 * (left + right) - mid) + (high - low) * width * width / 12.0;
    left = right;
  }
  const double slope_db_per_s = product / (span * span * span / 12.0);
  if (!(slope_db_per_s < 0)) return std::nullopt;
  return -60.0 / slope_db_per_s;
}

/// Decay time of the regression line through the points of a decay curve, one at the start of each bin, from 0 to -10 dB
/// (ISO 3382-1:2009, A.2.2).  nullopt of fewer than three, and of a curve that falls from this range into silence.  whole: energy with the
/// direct sound where it arrives.
std::optional<double> early_decay_time(std::span<const double> whole, double bin_s) {
  std::vector<double> left(whole.size());
  energy_decay_curve(whole, left);
  double count = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0;; ++i) {
    if (i == left.size() || !(left[i] > 0)) return std::nullopt;
    const double level_db = decibels(left[i] / left[0]), time_s = static_cast<double>(i) * bin_s;
    if (level_db < -10.0) break;
    count += 1, x += time_s, y += level_db, xx += time_s * time_s, xy += time_s * level_db;
  }
  const double slope_db_per_s = count < 3 ? 0.0 : (count * xy - x * y) / (count * xx - x * x);
  return slope_db_per_s < 0 ? std::optional(-60.0 / slope_db_per_s) : std::nullopt;
}

double energy_before(std::span<const double> energy, double bin_s, double limit_s) {
  double sum = 0;
  for (std::size_t i = 0; i < energy.size(); ++i) {
    const double fraction = std::clamp(limit_s / bin_s - static_cast<double>(i), 0.0, 1.0);
    // 80 ms / 4 ms must be 20 bins, not 19.9999999 or a sliver of the 21st.
    sum += energy[i] * (fraction < 1e-9 ? 0.0 : fraction > 1.0 - 1e-9 ? 1.0 : fraction);
  }
  return sum;
}

}  // namespace

const char* name_of(DecayStatus status) {
  switch (status) {
    case DecayStatus::measured:
      return "measured";
    case DecayStatus::silent:
      return "silent";
    case DecayStatus::no_reverberation:
      return "nothing after the direct sound";
    case DecayStatus::too_few_points:
      return "over within three points";
    case DecayStatus::no_decay:
      return "does not fall";
    case DecayStatus::cut_short:
      return "response too short";
  }
  return "";
}

std::optional<double> level_ratio_db(double over, double under) {
  if (!(over > 0) || !(under > 0)) return std::nullopt;
  return decibels(over / under);
}

void energy_decay_curve(std::span<const double> energy, std::span<double> edc) {
  require(energy.size() == edc.size(), "edc", edc.size(), "must have the length of the energy series");
  double sum = 0;
  for (std::size_t i = energy.size(); i-- > 0;) {
    sum += energy[i];
    edc[i] = sum;
  }
}

double energy_between(std::span<const double> energy, double bin_s, double from_s, double to_s) {
  return energy_before(energy, bin_s, to_s) - energy_before(energy, bin_s, from_s);
}

BandMetrics measure_band(std::span<const double> energy, double bin_s, double direct_energy, std::span<const double> whole) {
  BandMetrics metrics;
  std::vector<double> edc(energy.size());
  energy_decay_curve(energy, edc);
  const double reverberant = edc.empty() ? 0.0 : edc[0];
  const double total = reverberant + direct_energy;
  if (!(total > 0) || !std::isfinite(total)) return metrics;

  metrics.g_db = decibels(total / kFreeField10m);
  metrics.drr_db = level_ratio_db(direct_energy, reverberant);
  double first_moment = 0;
  for (std::size_t i = 0; i < energy.size(); ++i) first_moment += energy[i] * (static_cast<double>(i) + 0.5) * bin_s;
  metrics.ts_s = first_moment / total;
  const double early50 = direct_energy + energy_before(energy, bin_s, 0.05), early80 = direct_energy + energy_before(energy, bin_s, 0.08);
  metrics.d50 = std::min(early50 / total, 1.0);
  metrics.c50_db = level_ratio_db(early50, total - early50);
  metrics.c80_db = level_ratio_db(early80, total - early80);
  metrics.decay = reverberant > 0 ? DecayStatus::too_few_points : DecayStatus::no_reverberation;
  if (!(reverberant > 0) || energy.size() < 3) return metrics;

  DecayCurve curve{.level_db = {}, .bin_s = bin_s};
  curve.level_db.reserve(edc.size() + 1);
  for (const double value : edc) curve.level_db.push_back(decibels(value / total));
  curve.level_db.push_back(kSilent);
  const double foot_db = curve.level_db[0];  // just after the direct step
  const MissingEnergy missing = missing_energy(energy, bin_s, total);
  const auto trusted = [&](double to_db) {
    constexpr double margin_db = 10.0;
    return missing.level_db <= to_db - margin_db;
  };
  const auto fit = [&](double from_db, double to_db) -> std::optional<double> {
    if (!trusted(to_db)) return std::nullopt;
    return fit_decay_time(curve, from_db, to_db);
  };
  metrics.edt_after_direct_s = fit(foot_db, foot_db - 10.0);
  if (trusted(-10.0) && whole.empty()) {
    std::vector<double> with_direct(energy.begin(), energy.end());
    with_direct[0] += direct_energy;
    metrics.edt_s = early_decay_time(with_direct, bin_s);
  } else if (trusted(-10.0)) {
    metrics.edt_s = early_decay_time(whole, bin_s);
  }
  const double from_db = std::min(-5.0, foot_db);
  metrics.t20_s = fit(from_db, from_db - 20.0);
  metrics.t30_s = fit(from_db, from_db - 30.0);
  metrics.rt60_s = metrics.t30_s ? metrics.t30_s : metrics.t20_s;
  metrics.decay = metrics.rt60_s            ? DecayStatus::measured
                  : trusted(from_db - 20.0) ? DecayStatus::too_few_points
                  : missing.falls           ? DecayStatus::cut_short
                                            : DecayStatus::no_decay;
  return metrics;
}

}  // namespace earshot
