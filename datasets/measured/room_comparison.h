// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "datasets/measured/measured_room.h"
#include "datasets/measured/octave_decay.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// A measured response beside the simulated one of the same place.
struct ComparedPlace {
  std::string name;
  double distance_m = 0;
  std::vector<OctaveDecay> measured, simulated;  ///< of the same octaves
};

/// Differences of simulation and measurement: means over all places and octaves in which both have the value.
struct ComparedValue {
  int count = 0;
  std::optional<double> error, bias;  ///< mean of sizes, mean; simulated minus measured; nullopt: no value
};

/// As Chen et al. 2022 (SoundSpaces 2.0), section 4.2, compare: relative errors of decay times and errors of ratios in dB.
struct RoomComparison {
  std::vector<double> bands_hz;
  std::vector<ComparedPlace> places;
  ComparedValue t20_percent, edt_percent;
  ComparedValue drr_db;  ///< from kLowestDrrHz on
  ComparedValue c50_db;
  ComparedValue decay_db;  ///< RMS difference of the decay curves while the measured one lies above -25 dB; no bias
};

/// Distance of two decay curves, as above; nullopt where the measured one has fewer than three points.
std::optional<double> decay_difference_db(const OctaveDecay& measured, const OctaveDecay& simulated);
/// Fills in the means from the places.
void summarize(RoomComparison& comparison);

/// Throws InputError for places that cannot be meant (place_check.h), naming the response, and for a room without a common octave.
void check_places(const AcousticScene& scene, const MeasuredRoom& room);

/// Simulates every place, renders it for an omnidirectional microphone under eight noises, and reads both by octave_decays: the same
/// filters, the same windows.  A record is one draw of what the simulation gives the mean of: at decay time T an octave of width B has
/// about 2 B T / 13.8 independent parts, so its energy scatters by the root of 2 over that number.
/// A pure function of its arguments and the config.  Cost: one response each, and its synthesis.
RoomComparison compare_room(const AcousticScene& scene, const MeasuredRoom& room,
                            const std::function<void(std::size_t done)>& progress = {});

}  // namespace earshot
