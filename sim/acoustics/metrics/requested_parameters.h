// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/metrics/parameter_request.h"

namespace earshot {

/// A parameter that was asked for and that a response does not have.
struct MissingParameter {
  std::string key;     ///< as in JSON
  std::string reason;  ///< what it needs
  friend bool operator==(const MissingParameter&, const MissingParameter&) = default;
};

/// Energy of one band: bins of bin_s from time zero on, and what counts as direct sound.
struct BandEnergy {
  std::span<const double> after_direct;
  double bin_s;
  double direct;

  [[nodiscard]] double between(double from_s, double to_s) const { return energy_between(after_direct, bin_s, from_s, to_s); }
};

/// Lateral energy fraction J_LF or J_LFC (ISO 3382-1:2009, A.2.4): lateral energy from 5 to 80 ms over all energy up to 80 ms.  nullopt of
/// silence.
std::optional<double> lateral_fraction(std::span<const double> lateral, const BandEnergy& all);
/// Late lateral strength LG, the L_J of ISO 3382-1:2009: lateral energy after 80 ms over `reference`, energy at 10 m in a free field.
/// nullopt where what comes after the end of the series (missing_energy.h) lies less than 10 dB below: 0.4 dB.
std::optional<double> late_lateral_strength_db(std::span<const double> lateral, double bin_s, double reference);
/// Stage support (ISO 3382-1:2009, annex C): energy from 20 to 100 ms, and from 100 to 1000 ms, over that of the first 10 ms.
/// Sets those that `missing` does not have.
void add_stage_support(const BandEnergy& all, std::span<const MissingParameter> missing, BandMetrics& band);

/// What the stage parameters of a response hang on.
struct StageConditions {
  bool has_direct;
  std::optional<double> distance_m;  ///< of the direct sound, nullopt where it is not known
  double length_s;                   ///< of the response after the direct sound
};
/// Reasons of the stage parameters, of the lateral ones (length_s as above), and of all that are on request where nothing arrives.  A
/// parameter keeps the first reason.
void add_missing_stage(const StageConditions& conditions, std::vector<MissingParameter>& missing);
void add_missing_lateral(double length_s, std::vector<MissingParameter>& missing);
void add_missing_silent(const ParameterRequest& request, std::vector<MissingParameter>& missing);
/// Reasons of the lateral and stage parameters that single bands lack.
void add_missing_bands(const ParameterRequest& request, std::span<const float> bands_hz, std::span<const BandMetrics> bands,
                       std::vector<MissingParameter>& missing);
bool is_missing(std::span<const MissingParameter> missing, const char* key);

/// Sets MTI of each octave from 125 Hz to 8 kHz and returns STI; energies: of each band.  nullopt, with the reason, where an octave is
/// missing or silent, or what comes after its end (missing_energy.h) lies less than 20 dB below it: 0.01 of the index.
std::optional<double> add_speech_transmission(const ParameterRequest& request, std::span<const float> bands_hz,
                                              std::span<const std::vector<double>> after_direct, std::span<const double> direct,
                                              double bin_s, std::span<BandMetrics> bands, std::vector<MissingParameter>& missing);

}  // namespace earshot
