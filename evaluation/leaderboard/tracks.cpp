// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>

#include "evaluation/results/result.h"
#include "sim/base/control_characters.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

constexpr std::string_view kSection = "observation.";

bool is_picture(const SensorSpec& sensor) { return sensor.camera >= 0; }
bool is_heard(const SensorSpec& sensor) { return source_of(sensor.kind) == SensorSource::ears; }

/// "observation.rgb", "observation.cameras.back.rgb": says whether there is a sensor, not what it is like.
bool is_switch(const std::string& key) {
  constexpr std::array<std::string_view, 16> switches{
      "depth",     "rgb",         "semantic", "normals",   "spectrogram",     "interaural",  "waveform",      "heard",
      "pointgoal", "gps_compass", "pose",     "collision", "previous_action", "topdown_map", "oracle_action", "goal_state"};
  const std::string_view name = std::string_view(key).substr(key.rfind('.') + 1);
  const bool placed = key == std::string(kSection) + std::string(name) || key.starts_with("observation.cameras.");
  return placed && std::ranges::find(switches, name) != switches.end();
}

/// Whether what these sensors show depends on the setting.
bool matters(const std::string& key, std::span<const SensorSpec> read) {
  const std::string name = key.substr(kSection.size());
  const auto reads = [&](const auto& condition) { return std::ranges::any_of(read, condition); };
  const auto reads_kind = [&](SensorKind kind) { return reads([&](const SensorSpec& sensor) { return sensor.kind == kind; }); };
  const auto is_main = [](const SensorSpec& sensor) {
    return is_picture(sensor) && (sensor.name == "depth" || sensor.name == "rgb" || sensor.name == "semantic" || sensor.name == "normals");
  };
  if (name.starts_with("camera.")) return reads(is_main);
  if (name == "unlit") return reads([](const SensorSpec& sensor) { return sensor.name == "rgb"; });
  if (name == "renderer") return reads(is_picture);
  if (name.starts_with("cameras.")) {
    const std::string camera = name.substr(8, name.find('.', 8) - 8) + "_";
    return reads([&](const SensorSpec& sensor) { return is_picture(sensor) && sensor.name.starts_with(camera); });
  }
  if (name == "depth_noise") return reads_kind(SensorKind::depth);
  if (name == "noise.position_m" || name == "noise.heading_deg")
    return reads([](const SensorSpec& sensor) { return source_of(sensor.kind) == SensorSource::odometry; });
  if (name.starts_with("noise.")) return reads_kind(SensorKind::depth);
  if (name == "legacy_spectrogram") return reads_kind(SensorKind::spectrogram);
  if (name.starts_with("map.")) return reads_kind(SensorKind::topdown_map);
  return name != "egl_device" && name != "cameras";
}

/// Every sensor that an agent could have: all of the main camera and of the further ones, of the ears and of the way.
std::vector<SensorSpec> all_sensors(ObservationSpec spec) {
  spec.depth = spec.rgb = spec.semantic = spec.normals = true;
  spec.spectrogram = spec.interaural = spec.waveform = spec.heard = true;
  spec.pointgoal = spec.gps_compass = spec.pose = spec.collision = spec.previous_action = true;
  spec.topdown_map = spec.oracle_action = spec.goal_state = true;
  for (ExtraCamera& camera : spec.cameras) camera.depth = camera.rgb = camera.semantic = camera.normals = true;
  return sensor_table(spec, 1);
}

}  // namespace

std::vector<Track> default_tracks() {
  const std::vector<std::string> ears{"spectrogram", "interaural", "waveform", "heard", "collision", "previous_action"};
  std::vector<std::string> eyes = ears;
  eyes.insert(eyes.end(), {"depth", "rgb"});
  std::vector<std::string> odometry = eyes;
  odometry.insert(odometry.end(), {"gps_compass", "pose"});
  return {{"ears", ears}, {"ears and eyes", eyes}, {"with odometry", odometry}};
}

std::vector<Track> read_tracks(ConfigReader& section, const ObservationSpec& observation) {
  ConfigReader reader = section.child("tracks", kTracksAbout);
  const std::vector<SensorSpec> all = all_sensors(observation);
  std::vector<Track> tracks;
  std::set<std::string> names{kAnything};
  for (const std::string& name : reader.free_keys("NAME")) {
    Track track{.name = name, .sensors = {}};
    reader.read_required(name, track.sensors, Allowed::text("the name of a sensor"), "Sensors of a track, one of the ears among them.");
    if (reader.is_describing()) continue;
    if (has_control_character(name) || !names.insert(name).second) reader.fail(name, "cannot be the name of a track");
    bool hears = false;
    for (const std::string& sensor : track.sensors) {
      const SensorSpec* known = find_sensor(all, sensor);
      if (known == nullptr) reader.fail(name, "'" + sensor + "' is not a sensor");
      if (known->privileged)
        reader.fail(name, fmt::format("'{}' is privileged: it is derived from the {}", sensor, name_of(source_of(known->kind))));
      hears = hears || is_heard(*known);
    }
    if (!hears) reader.fail(name, "has no sensor of the ears");
    tracks.push_back(std::move(track));
  }
  reader.finish();
  return tracks.empty() ? default_tracks() : tracks;
}

const Track* track_of(std::span<const Track> tracks, std::span<const SensorSpec> read) {
  if (std::ranges::none_of(read, is_heard)) return nullptr;
  for (const Track& track : tracks)
    if (std::ranges::all_of(read, [&](const SensorSpec& sensor) { return std::ranges::count(track.sensors, sensor.name) > 0; }))
      return &track;
  return nullptr;
}

std::string no_track_reason(std::span<const Track> tracks, std::span<const SensorSpec> read) {
  for (const SensorSpec& sensor : read) {
    const auto has = [&](const Track& track) { return std::ranges::count(track.sensors, sensor.name) > 0; };
    if (std::ranges::any_of(tracks, has)) continue;
    if (!sensor.privileged) return fmt::format("reads '{}', which is not a sensor of any track", sensor.name);
    return fmt::format("reads '{}', which is privileged: it is derived from the {}", sensor.name, name_of(source_of(sensor.kind)));
  }
  if (std::ranges::none_of(read, is_heard)) return "reads no sensor of the ears";
  return "reads sensors that no track has together";
}

bool is_sensor_key(const std::string& key) { return key.starts_with(kSection); }

std::vector<SettingChange> changed_settings(const SensedConfig& ours, const SensedConfig& theirs, std::span<const SensorSpec> read) {
  std::vector<SettingChange> changed;
  for (const ConfigChange& change : config_changes(theirs, ours))
    if (is_sensor_key(change.key) && !is_switch(change.key) && matters(change.key, read))
      changed.push_back({.key = "env." + change.key, .theirs = change.before, .ours = change.now});
  return changed;
}

}  // namespace earshot
