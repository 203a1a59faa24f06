#include "bench/response_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sim/acoustics/metrics/interaural.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

struct ErrorName {
  const char* name;
  double scale;
};
constexpr std::array<ErrorName, kNumErrorKinds> kNames{{{"t20_pct", 100},
                                                        {"t30_pct", 100},
                                                        {"edt_pct", 100},
                                                        {"c50_db", 1},
                                                        {"drr_db", 1},
                                                        {"edc_rms_db", 1},
                                                        {"rir_t20_pct", 100},
                                                        {"rir_to_rir_t20_pct", 100},
                                                        {"ild_db", 1},
                                                        {"iacc", 1},
                                                        {"lsd_db", 1}}};

double decibels(double ratio) { return ratio > 0 ? 10 * std::log10(ratio) : -std::numeric_limits<double>::infinity(); }

void add_difference(std::vector<double>& values, const std::optional<double>& reference, const std::optional<double>& test) {
  if (reference) values.push_back(test ? *test - *reference : kMissing);
}

void add_relative(std::vector<double>& values, const std::optional<double>& reference, const std::optional<double>& test) {
  if (reference && *reference > 0) values.push_back(test ? *test / *reference - 1 : kMissing);
}

/// The band of `metrics` whose centre is within a sixth of an octave; null if there is none.
const BandMetrics* band_near(const RoomMetrics& metrics, float centre_hz) {
  for (std::size_t b = 0; b < metrics.bands.size(); ++b)
    if (std::abs(std::log2(metrics.bands_hz[b] / centre_hz)) < 1.f / 6) return &metrics.bands[b];
  return nullptr;
}

}  // namespace

const char* name_of(ErrorKind kind) { return kNames[static_cast<std::size_t>(kind)].name; }
double scale_of(ErrorKind kind) { return kNames[static_cast<std::size_t>(kind)].scale; }

std::optional<double> decay_rms_db(std::span<const double> reference, std::span<const double> test, double range_db) {
  require(reference.size() == test.size(), "series", test.size(), "must be as long as the reference");
  std::vector<double> truth(reference.size()), other(test.size());
  energy_decay_curve(reference, truth);
  energy_decay_curve(test, other);
  if (truth.empty() || !(truth[0] > 0) || !(other[0] > 0)) return std::nullopt;
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double level = decibels(truth[i] / truth[0]);
    if (level < -range_db) break;
    // Before the first arrival both are 0 dB: that is no agreement of decays.
    if (level == 0 && i + 1 < truth.size() && truth[i + 1] == truth[0]) continue;
    const double difference = std::max(decibels(other[i] / other[0]), kEndedDb) - level;
    squares += difference * difference;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return std::sqrt(squares / count);
}

std::optional<double> log_spectral_distance_db(std::span<const float> reference, std::span<const float> test, double range_db) {
  require(reference.size() == test.size(), "spectrogram", test.size(), "must have the shape of the reference");
  double loudest = 0;
  for (const float value : reference) loudest = std::max(loudest, std::expm1(double{value}));
  if (!(loudest > 0)) return std::nullopt;
  const double floor = loudest * std::pow(10.0, -range_db / 20);
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const double truth = std::expm1(double{reference[i]});
    if (truth < floor) continue;
    const double difference = 20 * std::log10(std::max(std::expm1(double{test[i]}), floor) / truth);
    squares += difference * difference;
    ++count;
  }
  return std::sqrt(squares / count);
}

std::optional<double> level_difference_db(const Rir& rir) {
  if (rir.num_channels != 2) return std::nullopt;
  double left = 0, right = 0;
  for (const float sample : rir.channel(0)) left += double{sample} * sample;
  for (const float sample : rir.channel(1)) right += double{sample} * sample;
  if (!(left > 0) || !(right > 0)) return std::nullopt;
  return decibels(left / right);
}

std::optional<double> mean_interaural_correlation(const Rir& rir, double direct_delay_s) {
  if (rir.num_channels != 2) return std::nullopt;
  double sum = 0;
  int count = 0;
  for (const int band : {2, 3, 4}) {  // 500 Hz, 1 and 2 kHz of the octaves from 125 Hz on
    const auto value = interaural_correlation(rir.channel(0), rir.channel(1), rir.sample_rate_hz, direct_delay_s, band).total;
    if (value) sum += *value, ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

PoseErrors compare(const HeardResponse& reference, const HeardResponse& test) {
  PoseErrors errors;
  const auto of = [&](ErrorKind kind) -> std::vector<double>& { return errors.values[static_cast<std::size_t>(kind)]; };
  if (reference.energy.bands_hz == test.energy.bands_hz) {
    for (std::size_t b = 0; b < reference.energy.bands.size(); ++b) {
      const BandMetrics &truth = reference.energy.bands[b], &other = test.energy.bands[b];
      add_relative(of(ErrorKind::t20), truth.t20_s, other.t20_s);
      add_relative(of(ErrorKind::t30), truth.t30_s, other.t30_s);
      add_relative(of(ErrorKind::edt), truth.edt_s, other.edt_s);
      add_difference(of(ErrorKind::c50_db), truth.c50_db, other.c50_db);
      if (const auto rms = decay_rms_db(reference.series[b], test.series[b])) of(ErrorKind::decay_db).push_back(*rms);
    }
  }
  add_difference(of(ErrorKind::drr_db), reference.energy.drr_db, test.energy.drr_db);
  for (std::size_t b = 0; b < reference.energy.bands.size(); ++b)
    if (const BandMetrics* heard = band_near(test.rir, reference.energy.bands_hz[b])) {
      add_relative(of(ErrorKind::rir_t20), reference.energy.bands[b].t20_s, heard->t20_s);
      if (const BandMetrics* truth = band_near(reference.rir, reference.energy.bands_hz[b]))
        add_relative(of(ErrorKind::rir_to_rir_t20), truth->t20_s, heard->t20_s);
    }
  add_difference(of(ErrorKind::ild_db), reference.ild_db, test.ild_db);
  add_difference(of(ErrorKind::iacc), reference.iacc, test.iacc);
  if (!reference.spectrogram.empty())
    if (const auto distance = log_spectral_distance_db(reference.spectrogram, test.spectrogram))
      of(ErrorKind::spectral_db).push_back(*distance);
  return errors;
}

ErrorSummary summarise(std::span<const PoseErrors> poses, ErrorKind kind) {
  ErrorSummary summary;
  std::vector<double> sizes, pose_means;
  double sum = 0, squares = 0;
  for (const PoseErrors& pose : poses) {
    double pose_sum = 0;
    int pose_count = 0;
    for (const double value : pose.values[static_cast<std::size_t>(kind)]) {
      if (std::isnan(value)) {
        ++summary.missing;
        continue;
      }
      sizes.push_back(std::abs(value));
      pose_sum += sizes.back();
      ++pose_count;
      sum += sizes.back();
      squares += value * value;
    }
    if (pose_count > 0) pose_means.push_back(pose_sum / pose_count);
  }
  summary.count = static_cast<int>(sizes.size());
  if (sizes.empty()) {
    summary.mean = summary.rms = summary.p95 = summary.standard_error = kMissing;
    return summary;
  }
  const auto n = static_cast<double>(sizes.size());
  summary.mean = sum / n;
  summary.rms = std::sqrt(squares / n);
  std::sort(sizes.begin(), sizes.end());
  summary.p95 = sizes[static_cast<std::size_t>(std::ceil(0.95 * n)) - 1];
  const auto m = static_cast<double>(pose_means.size());
  double centre = 0, spread = 0;
  for (const double mean : pose_means) centre += mean / m;
  for (const double mean : pose_means) spread += (mean - centre) * (mean - centre);
  summary.standard_error = m > 1 ? std::sqrt(spread / (m * (m - 1))) : kMissing;
  return summary;
}

}  // namespace earshot
