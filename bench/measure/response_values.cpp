// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/response_values.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kDecayRangeDb = 30, kSpectralRangeDb = 40;
constexpr double kSilentDb = -400;

void add(std::vector<std::vector<double>>& items, const std::optional<double>& value) {
  std::vector<double>& item = items.emplace_back();
  if (value && std::isfinite(*value)) item.push_back(*value);
}

/// Decay times: those above 0.
void add_time(std::vector<std::vector<double>>& items, const std::optional<double>& time_s) {
  add(items, time_s && *time_s > 0 ? time_s : std::nullopt);
}

/// The band of `metrics` whose centre is within a sixth of an octave; null if there is none.
const BandMetrics* band_near(const RoomMetrics& metrics, float centre_hz) {
  for (std::size_t b = 0; b < metrics.bands.size(); ++b)
    if (std::abs(std::log2(metrics.bands_hz[b] / centre_hz)) < 1.f / 6) return &metrics.bands[b];
  return nullptr;
}

/// Level of the first 50 ms: G and the fraction D50 of it.
std::optional<double> early_level_db(const BandMetrics& band) {
  if (!band.g_db || !band.d50 || !(*band.d50 > 0)) return std::nullopt;
  return *band.g_db + 10 * std::log10(*band.d50);
}

std::vector<double> pixels_db(std::span<const float> spectrogram) {
  std::vector<double> levels;
  for (const float value : spectrogram) {
    const double magnitude = std::expm1(double{value});
    levels.push_back(magnitude > 0 ? 20 * std::log10(magnitude) : kSilentDb);
  }
  return levels;
}

/// Where the response itself is the truth, its rendered T20 stands for nothing: the energy's does.
void add_energy(const HeardResponse& heard, ResponseValues& values) {
  for (std::size_t b = 0; b < heard.energy.bands.size(); ++b) {
    const BandMetrics& band = heard.energy.bands[b];
    add_time(values.of(ErrorKind::t20), band.t20_s);
    add_time(values.of(ErrorKind::t30), band.t30_s);
    add_time(values.of(ErrorKind::edt), band.edt_after_direct_s);
    add(values.of(ErrorKind::c50_db), band.c50_db);
    add(values.of(ErrorKind::drr_band_db), band.drr_db);
    add(values.of(ErrorKind::early_db), early_level_db(band));
    add(values.of(ErrorKind::level_db), band.g_db);
    values.of(ErrorKind::decay_db).push_back(b < heard.series.size() ? decay_levels_db(heard.series[b]) : std::vector<double>{});
  }
}

void add_heard(const HeardResponse& heard, ResponseValues& values) {
  add(values.of(ErrorKind::drr_db), heard.energy.drr_db);
  for (const InterauralBand& band : heard.ears) {
    add(values.of(ErrorKind::ild_db), band.ild_db);
    add(values.of(ErrorKind::itd_us), band.itd_s);
    add(values.of(ErrorKind::iacc), band.iacc);
  }
  values.of(ErrorKind::spectral_db).push_back(pixels_db(heard.spectrogram));
}

}  // namespace

std::vector<double> decay_levels_db(std::span<const double> series) {
  std::vector<double> curve(series.size());
  energy_decay_curve(series, curve);
  std::vector<double> levels;
  if (curve.empty() || !(curve[0] > 0)) return levels;
  for (const double left : curve) levels.push_back(left > 0 ? std::max(10 * std::log10(left / curve[0]), kEndedDb) : kEndedDb);
  return levels;
}

ResponseValues truth_values(const HeardResponse& truth) {
  ResponseValues values;
  add_energy(truth, values);
  add_heard(truth, values);
  for (std::size_t b = 0; b < truth.energy.bands.size(); ++b) {
    const BandMetrics* heard = band_near(truth.rir, truth.energy.bands_hz[b]);
    add_time(values.of(ErrorKind::rir_t20), truth.energy.bands[b].t20_s);
    add_time(values.of(ErrorKind::rir_to_rir_t20), heard ? heard->t20_s : std::nullopt);
  }
  return values;
}

ResponseValues test_values(const HeardResponse& test, const HeardResponse& truth) {
  ResponseValues values;
  if (test.energy.bands_hz == truth.energy.bands_hz) add_energy(test, values);
  add_heard(test, values);
  for (const float centre_hz : truth.energy.bands_hz)
    for (const ErrorKind kind : {ErrorKind::rir_t20, ErrorKind::rir_to_rir_t20}) {
      const BandMetrics* heard = band_near(test.rir, centre_hz);
      add_time(values.of(kind), heard ? heard->t20_s : std::nullopt);
    }
  return values;
}

std::optional<double> decay_product(std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                    std::span<const double> b, double range_db) {
  if (a.empty() || b.empty()) return std::nullopt;
  const auto level = [](std::span<const double> curve, std::size_t i) { return curve.empty() ? kEndedDb : curve[i]; };
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double truth = 0.5 * (level(a, i) + level(b, i));
    if (truth < -range_db) break;
    if (truth == 0 && i + 1 < a.size() && level(a, i + 1) + level(b, i + 1) == 0) continue;
    sum += (level(x, i) - level(a, i)) * (level(y, i) - level(b, i));
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

std::optional<double> spectral_product(std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                       std::span<const double> b, double range_db) {
  require(x.size() == a.size() && y.size() == b.size() && a.size() == b.size(), "spectrogram", x.size(),
          "must have the shape of the reference");
  const auto truth = [&](std::size_t i) { return 0.5 * (a[i] + b[i]); };
  double loudest = kSilentDb;
  for (std::size_t i = 0; i < a.size(); ++i) loudest = std::max(loudest, truth(i));
  if (!(loudest > kSilentDb)) return std::nullopt;
  const double floor = loudest - range_db;
  const auto heard = [&](double level) { return std::max(level, floor); };
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (truth(i) < floor) continue;
    sum += (heard(x[i]) - a[i]) * (heard(y[i]) - b[i]);
    ++count;
  }
  return sum / count;
}

std::optional<double> difference_product(ErrorKind kind, std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                         std::span<const double> b) {
  if (kind == ErrorKind::decay_db) return decay_product(x, y, a, b, kDecayRangeDb);
  if (kind == ErrorKind::spectral_db) return spectral_product(x, y, a, b, kSpectralRangeDb);
  const double first = x[0] - a[0], second = y[0] - b[0];
  return facts_of(kind).relative ? first / a[0] * (second / b[0]) : first * second;
}

}  // namespace earshot
