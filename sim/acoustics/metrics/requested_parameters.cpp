// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/requested_parameters.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sim/acoustics/metrics/speech_transmission.h"

namespace earshot {
namespace {

constexpr double kLateralFromS = 0.005, kEarlyEndS = 0.08;
constexpr double kStageDirectEndS = 0.01, kStageFromS = 0.02, kStageEarlyEndS = 0.1, kStageEndS = 1.0;
/// Listeners this near to 1 m from the source count as at 1 m: 0.4 dB of its direct sound.
constexpr double kStageDistanceM = 1.0, kStageToleranceM = 0.05;

}  // namespace

std::optional<double> lateral_fraction(std::span<const double> lateral, const BandEnergy& all) {
  const double early = all.direct + all.between(0, kEarlyEndS);
  if (!(early > 0) || !std::isfinite(early)) return std::nullopt;
  return energy_between(lateral, all.bin_s, kLateralFromS, kEarlyEndS) / early;
}

std::optional<double> late_lateral_strength_db(std::span<const double> lateral, double bin_s, double reference) {
  return level_ratio_db(energy_between(lateral, bin_s, kEarlyEndS, std::numeric_limits<double>::infinity()), reference);
}

void add_stage_support(const BandEnergy& all, BandMetrics& band) {
  const double direct = all.direct + all.between(0, kStageDirectEndS);
  band.st_early_db = level_ratio_db(all.between(kStageFromS, kStageEarlyEndS), direct);
  band.st_late_db = level_ratio_db(all.between(kStageEarlyEndS, kStageEndS), direct);
}

void add_missing_stage(std::optional<double> distance_m, double length_s, std::vector<MissingParameter>& missing) {
  if (distance_m && !(std::abs(*distance_m - kStageDistanceM) <= kStageToleranceM)) {
    const std::string reason = fmt::format("needs a listener at 1 m from the source; this one is {:.3g} m away", *distance_m);
    missing.push_back({"st_early_db", reason});
    missing.push_back({"st_late_db", reason});
  } else if (length_s < kStageEndS) {
    missing.push_back(
        {"st_late_db", fmt::format("needs a response of 1 s after the direct sound; this one ends after {:.3g} s", length_s)});
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
  for (std::size_t k = 0; k < kSpeechOctaves; ++k) {
    const std::size_t band = (*octaves)[k];
    const double snr_db = request.snr_db.empty()       ? std::numeric_limits<double>::infinity()
                          : request.snr_db.size() == 1 ? request.snr_db[0]
                                                       : request.snr_db[k];
    bands[band].mti = modulation_transfer_index(after_direct[band], bin_s, direct[band], snr_db);
    if (!bands[band].mti) {
      missing.push_back({"sti", fmt::format("the octave at {:.0f} Hz is silent", bands_hz[band])});
      return std::nullopt;
    }
    indices[k] = *bands[band].mti;
  }
  return speech_transmission_index(indices);
}

}  // namespace earshot
