#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// Is there a decay time, and if not, why (docs/stability.md, H-75)?
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
  std::optional<double> edt_s, t20_s, t30_s, rt60_s, c50_db, c80_db, d50, ts_s, g_db, drr_db;
  std::optional<double> iacc, iacc_early, iacc_late;  ///< of two channels only: interaural.h
};
struct RoomMetrics {
  std::vector<float> bands_hz;
  std::vector<BandMetrics> bands;
  std::optional<double> drr_db;                            ///< broadband: of a source with equal energy per hertz
  std::optional<double> direct_delay_s, direct_amplitude;  ///< nullopt without line of sight; amplitude: rms over hertz
};

/// Energy decay curve: backward integral (Schroeder 1965), summed in double.  energy, edc: [n]; edc in the units of energy.
/// edc[i] is what is left from the start of bin i on.
void energy_decay_curve(std::span<const double> energy, std::span<double> edc);

/// Decay parameters of one energy series with bins of `bin_s`, time zero at the direct arrival; direct energy separate so that EDT
/// starts after it.  rt60_s = T30 if the decay reaches -35 dB, else T20.
///
/// Decay times are least-squares lines through the decay curve in dB, taken as straight between bin edges, so that a range may begin
/// and end inside a bin.
///  - T20, T30: -5 to -25 and -35 dB of the whole curve, direct included.  Where the direct sound alone is a step below -5 dB, the range
///    keeps its span and begins at the foot of the step.
///  - EDT: the first 10 dB after the direct step.
///  - A response that stops before it has decayed has a curve that falls too steeply at its end.  The level of what is missing is estimated
///  from the energy at
///    the end and its rate of decay over the second half; a range is only fitted if it ends 10 dB above that level, which
///    keeps the bias below 1 % for T30, 2 % for T20 and 4 % for EDT (docs/oracles.md, O-25).
///  - Fewer than three points of the curve in the range, or a curve that does not fall: nullopt.
/// C50, C80, D50: energy at the limit or after it is late.  DRR, C50 and C80 are nullopt where a side is zero.
BandMetrics measure_band(std::span<const double> energy, double bin_s, double direct_energy);

/// From the energy response: exact times, no carrier noise.  Time zero is the direct arrival, or, without line of sight, the first
/// arrival of any kind.  Direct and diffracted sound interfere: their energies are added with the cross terms' band means, so that levels
/// are continuous through a shadow boundary; in sight, what is diffracted within 2.5 ms belongs to the direct sound.
RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response);
/// From one channel of a rendered RIR: zero-phase octave filters, energies in 1 ms windows.  The direct sound is what lies within 2.5 ms of
/// `direct_delay_s`.  Shorter than 16 / bandwidth a decay is that of the filter (docs/oracles.md, O-25).
RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s);

/// The same of channel 0 of a RIR; with two channels the correlation between them is added.
RoomMetrics measure(const Rir& rir, double direct_delay_s);

}  // namespace earshot
