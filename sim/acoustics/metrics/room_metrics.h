// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/metrics/requested_parameters.h"
#include "sim/acoustics/metrics/rir_measurement.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

struct RoomMetrics {
  std::vector<float> bands_hz;
  std::vector<BandMetrics> bands;
  std::optional<double> drr_db;                            ///< broadband: of a source with equal energy per hertz
  std::optional<double> direct_delay_s, direct_amplitude;  ///< nullopt without line of sight; amplitude: rms over hertz
  std::optional<double> first_arrival_s;                   ///< time zero of an energy response; nullopt of silence and of samples
  std::optional<double> sti;                               ///< on request
  std::vector<MissingParameter> missing;                   ///< of those on request and of G, with reasons
};

/// From the energy response: exact times, no carrier noise.  Time zero is the direct arrival, or, without line of sight, the first
/// arrival of any kind.  Direct and diffracted sound interfere: their energies are added with the cross terms' band means, so that levels
/// are continuous through a shadow boundary; in sight, sound diffracted within 2.5 ms counts as direct sound.
RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response, const ParameterRequest& request = {});

/// From one channel of a RIR: zero-phase filters, energies in 1 ms windows.  The direct sound is what lies within 2.5 ms of its time.
/// Shorter than 16 / bandwidth a decay is that of the filter (docs/evidence/oracles.md, O-25).  Throws InputError by check_measurement.
RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, const RirMeasurement& how);
/// Of samples in Green units.
RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s);

/// The same of channel 0 of a RIR; with two channels the correlation between them is added, in windows from the earlier onset on.
RoomMetrics measure(const Rir& rir, const RirMeasurement& how);
RoomMetrics measure(const Rir& rir, double direct_delay_s);

/// The correlation between two channels alone: iacc, iacc_early and iacc_late of each band.
std::vector<BandMetrics> measure_interaural(const Rir& rir, const RirMeasurement& how);

}  // namespace earshot
