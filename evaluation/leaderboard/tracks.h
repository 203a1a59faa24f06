// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "envs/sensors/sensor.h"
#include "evaluation/results/sensed_config.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

/// Comparable agents: those that read only these sensors, as the environment of the benchmark sets them up, and some sensor of
/// the ears.
struct Track {
  std::string name;
  std::vector<std::string> sensors;  ///< by their names in the sensor table
};

/// "ears", "ears and eyes", "with odometry": sound and the last action and collision; and depth and colours; and gps_compass and pose.
std::vector<Track> default_tracks();

inline constexpr About kTracksAbout("Tracks by name, narrow ones first: the sensors that agents of a track may read.");
/// Section `tracks` of a benchmark: a list of sensors for each name, narrow ones first; without one default_tracks().  observation: the
/// sensors that there are.  Throws InputError: a sensor that there is not or that is privileged, a name in use or with control characters,
/// no sensor of the ears.
std::vector<Track> read_tracks(ConfigReader& section, const ObservationSpec& observation);

/// The first track that has all of these sensors; null: none has, or none of them is of the ears.
const Track* track_of(std::span<const Track> tracks, std::span<const SensorSpec> read);
/// Reason why track_of returns no track: the first sensor that is in none of the tracks, or a missing sound sensor.
std::string no_track_reason(std::span<const Track> tracks, std::span<const SensorSpec> read);

/// A setting of sensors that are read which differs from the benchmark's: its key, and both values; empty: none does.  ours, theirs: as
/// sensed_config gives them.
struct SettingChange {
  std::string key, theirs, ours;
};
std::vector<SettingChange> changed_settings(const SensedConfig& ours, const SensedConfig& theirs, std::span<const SensorSpec> read);

/// Whether a key of sensed_config is one of the section `observation`: which sensors there are, and what they are made with.
bool is_sensor_key(const std::string& key);

}  // namespace earshot
