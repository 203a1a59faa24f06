// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace earshot {

/// Is there a decay time, and if not, why (docs/evidence/stability.md, H-75)?
enum class DecayStatus : std::uint8_t {
  measured,          ///< rt60_s exists
  silent,            ///< nothing arrives, or nothing finite
  no_reverberation,  ///< nothing comes after the direct sound: all is absorbed, or there is nothing to come back from
  too_few_points,    ///< the decay is over within three points of its curve
  no_decay,          ///< the energy does not fall: a rigid room (infinite time), a noise floor, a growing response
  cut_short          ///< it falls, but the response ends before it has fallen far enough
};
const char* name_of(DecayStatus status);

/// Room-acoustic parameters per band (ISO 3382-1).  A value that does not exist (open field, too little decay) is nullopt.
struct BandMetrics {
  DecayStatus decay = DecayStatus::silent;
  std::optional<double> edt_s, edt_after_direct_s, t20_s, t30_s, rt60_s, c50_db, c80_db, d50, ts_s, g_db, drr_db;
  std::optional<double> iacc, iacc_early, iacc_late;  ///< of two channels only: interaural.h
  /// On request only (parameter_request.h): lateral energy fractions and late lateral strength, stage support, modulation transfer index.
  std::optional<double> j_lf, j_lfc, lg_db, st_early_db, st_late_db, mti;
};

/// 10 log10(over / under); nullopt where one of the two is not positive.
std::optional<double> level_ratio_db(double over, double under);

/// Energy decay curve: backward integral (Schroeder 1965), summed in double.  energy, edc: [n]; edc in the units of energy.
/// edc[i] is what is left from the start of bin i on.
void energy_decay_curve(std::span<const double> energy, std::span<double> edc);

/// Decay parameters of one energy series with bins of `bin_s`, time zero at the direct arrival; direct energy separate.  rt60_s = T30 if
/// the decay reaches -35 dB, else T20.
///
/// Decay times but EDT are least-squares lines through the decay curve in dB, taken as straight between bin edges, so that a range may
/// begin and end inside a bin.
///  - T20, T30: -5 to -25 and -35 dB of the whole curve, direct included.  Where the direct sound alone is a step below -5 dB, the range
///    keeps its span and begins at the foot of the step.
///  - EDT: regression over the points of the whole curve, direct included, that lie between 0 and -10 dB, one at the start of each bin
///    (ISO 3382-1: bins of 1 ms).  Fewer than three, as behind a direct step of nearly 10 dB: nullopt.
///  - EDT after the direct sound: the first 10 dB below the foot of the direct step.
///  - A response that stops before it has decayed has a curve that falls too steeply at its end.  The level of what is missing is estimated
///  from the energy at
///    the end and its rate of decay over the second half; a range is only fitted if it ends 10 dB above that level, which
///    keeps the bias below 1 % for T30, 2 % for T20 and 4 % for EDT (docs/evidence/oracles.md, O-25).
///  - Fewer than three points of the curve in the range, or a curve that does not fall: nullopt.
/// C50, C80, D50: energy at the limit or after it is late.  DRR, C50 and C80 are nullopt where a side is zero.
/// whole: [energy.size()], the same series with the direct sound where it arrives, which EDT is taken from; empty: all of it in the first
/// bin.
BandMetrics measure_band(std::span<const double> energy, double bin_s, double direct_energy, std::span<const double> whole = {});

/// Energy in [from_s, to_s) after time zero; that of a bin is spread evenly over it.
double energy_between(std::span<const double> energy, double bin_s, double from_s, double to_s);

/// Energy of a unit source at 10 m in a free field, Green units: the reference of strength.
inline constexpr double kFreeField10m = 6.332573977646111e-5;  // 1 / (4 pi 10)^2

}  // namespace earshot
