// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/requested_parameters.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "sim/acoustics/core/missing_energy.h"
#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/speech_transmission.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

constexpr double kLateralFromS = 0.005, kEarlyEndS = 0.08;
constexpr double kStageDirectEndS = 0.01, kStageFromS = 0.02, kStageEarlyEndS = 0.1, kStageEndS = 1.0;
/// Listeners this near to 1 m from the source count as at 1 m: 0.4 dB of its direct sound.
constexpr double kStageDistanceM = 1.0, kStageToleranceM = 0.05;
constexpr double kLateBelowDb = -10.0, kSpeechBelowDb = -20.0;  ///< of what a response lacks after its end
constexpr double kRoundingS = 1e-6;

bool is_whole(std::span<const double> energy, double bin_s, double below_db) {
  const double total = std::accumulate(energy.begin(), energy.end(), 0.0);
  return total > 0 && missing_energy(energy, bin_s, total).level_db <= below_db;
}

void add_reason(const char* key, const std::string& reason, std::vector<MissingParameter>& missing) {
  if (!is_missing(missing, key)) missing.push_back({key, reason});
}

std::string frequencies(const std::vector<float>& bands_hz) {
  std::vector<std::string> texts;
  for (const float hz : bands_hz) texts.push_back(fmt::format("{:.0f}", hz));
  return listed(texts, ", ") + " Hz";
}

std::string too_short(const char* needed, double length_s) {
  return fmt::format("needs a response of {} after the direct sound; this one ends after {:.3g} s", needed, length_s);
}

}  // namespace

std::optional<double> lateral_fraction(std::span<const double> lateral, const BandEnergy& all) {
  const double early = all.direct + all.between(0, kEarlyEndS);
  if (!(early > 0) || !std::isfinite(early)) return std::nullopt;
  return energy_between(lateral, all.bin_s, kLateralFromS, kEarlyEndS) / early;
}

std::optional<double> late_lateral_strength_db(std::span<const double> lateral, double bin_s, double reference) {
  const auto first = static_cast<std::size_t>(std::lround(kEarlyEndS / bin_s));
  if (lateral.size() <= first || !is_whole(lateral.subspan(first), bin_s, kLateBelowDb)) return std::nullopt;
  return level_ratio_db(energy_between(lateral, bin_s, kEarlyEndS, std::numeric_limits<double>::infinity()), reference);
}

void add_stage_support(const BandEnergy& all, std::span<const MissingParameter> missing, BandMetrics& band) {
  const double direct = all.direct + all.between(0, kStageDirectEndS);
  if (!is_missing(missing, "st_early_db")) band.st_early_db = level_ratio_db(all.between(kStageFromS, kStageEarlyEndS), direct);
  if (!is_missing(missing, "st_late_db")) band.st_late_db = level_ratio_db(all.between(kStageEarlyEndS, kStageEndS), direct);
}

void add_missing_stage(const StageConditions& conditions, std::vector<MissingParameter>& missing) {
  const auto both = [&](const std::string& reason) {
    for (const char* key : {"st_early_db", "st_late_db"}) add_reason(key, reason, missing);
  };
  const auto& [has_direct, distance_m, length_s] = conditions;
  if (!has_direct) both("needs a line of sight between source and listener");
  if (distance_m && !(std::abs(*distance_m - kStageDistanceM) <= kStageToleranceM))
    both(fmt::format("needs a listener at 1 m from the source; this one is {:.3g} m away", *distance_m));
  if (length_s < kStageEarlyEndS - kRoundingS) add_reason("st_early_db", too_short("100 ms", length_s), missing);
  if (length_s < kStageEndS - kRoundingS) add_reason("st_late_db", too_short("1 s", length_s), missing);
}

void add_missing_lateral(double length_s, std::vector<MissingParameter>& missing) {
  if (length_s >= kEarlyEndS - kRoundingS) return;
  for (const char* key : {"j_lf", "j_lfc", "lg_db"}) add_reason(key, too_short("80 ms", length_s), missing);
}

void add_missing_silent(const ParameterRequest& request, std::vector<MissingParameter>& missing) {
  constexpr const char* kReason = "the response is silent";
  for (const RequestedMetricKey& entry : kRequestedMetricKeys)
    if (request.*entry.group) add_reason(entry.key, kReason, missing);
  if (request.speech) add_reason("sti", kReason, missing);
}

void add_missing_bands(const ParameterRequest& request, std::span<const float> bands_hz, std::span<const BandMetrics> bands,
                       std::vector<MissingParameter>& missing) {
  for (const RequestedMetricKey& entry : kRequestedMetricKeys) {
    if (!(request.*entry.group) || entry.value == &BandMetrics::mti) continue;
    std::vector<float> lacking_hz;
    for (std::size_t band = 0; band < bands.size(); ++band)
      if (!(bands[band].*entry.value)) lacking_hz.push_back(bands_hz[band]);
    if (lacking_hz.empty()) continue;
    const char* reason =
        entry.value == &BandMetrics::lg_db ? "is silent after 80 ms, ends before it has decayed, or ends in noise, at " : "is silent at ";
    add_reason(entry.key, reason + frequencies(lacking_hz), missing);
  }
}

bool is_missing(std::span<const MissingParameter> missing, const char* key) {
  return std::any_of(missing.begin(), missing.end(), [&](const MissingParameter& one) { return one.key == key; });
}

std::optional<double> add_speech_transmission(const ParameterRequest& request, std::span<const float> bands_hz,
                                              std::span<const std::vector<double>> after_direct, std::span<const double> direct,
                                              double bin_s, std::span<BandMetrics> bands, std::vector<MissingParameter>& missing) {
  const auto octaves = speech_octaves(bands_hz);
  if (!octaves) {
    missing.push_back({"mti", "needs the seven octaves from 125 Hz to 8 kHz"});
    missing.push_back({"sti", "needs the seven octaves from 125 Hz to 8 kHz"});
    return std::nullopt;
  }
  std::array<double, kSpeechOctaves> indices{};
  std::vector<float> silent_hz, cut_hz;
  for (std::size_t k = 0; k < kSpeechOctaves; ++k) {
    const std::size_t band = (*octaves)[k];
    const double snr_db = request.snr_db.empty()       ? std::numeric_limits<double>::infinity()
                          : request.snr_db.size() == 1 ? request.snr_db[0]
                                                       : request.snr_db[k];
    const std::optional<double> index = modulation_transfer_index(after_direct[band], bin_s, direct[band], snr_db);
    const double total = std::accumulate(after_direct[band].begin(), after_direct[band].end(), direct[band]);
    if (!index)
      silent_hz.push_back(bands_hz[band]);
    else if (missing_energy(after_direct[band], bin_s, total).level_db > kSpeechBelowDb)
      cut_hz.push_back(bands_hz[band]);
    else
      indices[k] = *(bands[band].mti = index);
  }
  std::string reason;
  if (!silent_hz.empty()) reason = "is silent at " + frequencies(silent_hz);
  if (!cut_hz.empty()) reason += (reason.empty() ? "" : "; ") + ("ends before it has decayed, or in noise, at " + frequencies(cut_hz));
  if (!reason.empty()) {
    for (const char* key : {"mti", "sti"}) add_reason(key, reason, missing);
    return std::nullopt;
  }
  return speech_transmission_index(indices);
}

}  // namespace earshot
