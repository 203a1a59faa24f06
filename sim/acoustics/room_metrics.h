#pragma once

#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/rir.h"
#include "sim/acoustics/rir_synthesis.h"

namespace earshot {

/// Room-acoustic parameters per band (ISO 3382-1).  A value that does not exist (open field, too little decay) is nullopt.
struct BandMetrics {
  std::optional<double> edt_s, t20_s, t30_s, rt60_s, c50_db, c80_db, d50, ts_s, g_db, drr_db;
};
struct RoomMetrics {
  std::vector<float> bands_hz;
  std::vector<BandMetrics> bands;
  std::optional<double> drr_db;            ///< broadband
  std::optional<double> direct_delay_s, direct_amplitude;
};

/// Energy decay curve: backward integral (Schroeder 1965), summed in double.  energy, edc: [n]; edc in the units of energy.
void energy_decay_curve(std::span<const double> energy, std::span<double> edc);

/// Decay parameters of one energy series with bins of `bin_s`, time zero at the direct arrival; direct energy separate so that EDT
/// starts after it.  rt60_s = T30 if the decay reaches -35 dB, else T20.
BandMetrics measure_band(std::span<const double> energy, double bin_s, double direct_energy);

/// From the energy response: exact times, no carrier noise.
RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response);
/// From one channel of a rendered RIR: zero-phase octave filters, energies in 1 ms windows.
RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s);

}  // namespace earshot
