// SPDX-License-Identifier: Apache-2.0
#include "envs/sensors/sensor.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "envs/task/action.h"
#include "sim/audio/transforms/interaural_spectrogram.h"
#include "sim/scene/appearance.h"

namespace earshot {
namespace {

constexpr double kUnbounded = std::numeric_limits<double>::infinity();
constexpr double kPi = std::numbers::pi;

}  // namespace

std::size_t size_of(SensorType type) { return type == SensorType::uint8 ? 1 : type == SensorType::uint16 ? 2 : 4; }

std::string_view name_of(SensorType type) {
  constexpr std::array<std::string_view, 4> names{"float32", "uint8", "uint16", "int32"};
  return names[static_cast<std::size_t>(type)];
}

SensorSource source_of(SensorKind kind) {
  switch (kind) {
    case SensorKind::depth:
    case SensorKind::rgb:
      return SensorSource::eyes;
    case SensorKind::semantic:
    case SensorKind::normals:
      return SensorSource::labels;
    case SensorKind::spectrogram:
    case SensorKind::interaural:
    case SensorKind::waveform:
    case SensorKind::heard:
      return SensorSource::ears;
    case SensorKind::gps_compass:
    case SensorKind::pose:
      return SensorSource::odometry;
    case SensorKind::collision:
    case SensorKind::previous_action:
      return SensorSource::body;
    case SensorKind::topdown_map:
      return SensorSource::map;
    case SensorKind::pointgoal:
    case SensorKind::oracle_action:
    case SensorKind::goal_state:
      break;
  }
  return SensorSource::goal;
}

bool is_for_learner(SensorKind kind) { return kind == SensorKind::oracle_action || kind == SensorKind::goal_state; }

std::string_view name_of(SensorSource source) {
  constexpr std::array<std::string_view, 7> names{"eyes", "ears", "body", "odometry", "labels", "map", "goal"};
  return names[static_cast<std::size_t>(source)];
}

std::size_t SensorSpec::count() const {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1},
                         [](std::size_t product, int extent) { return product * static_cast<std::size_t>(extent); });
}

std::vector<SensorSpec> sensor_table(const ObservationSpec& spec, int step_samples) {
  std::vector<SensorSpec> table;
  const auto add = [&](bool on, std::string name, SensorKind kind, SensorType type, std::vector<int> shape, std::string units, double low,
                       double high) {
    if (on)
      table.push_back({.name = std::move(name),
                       .kind = kind,
                       .type = type,
                       .shape = std::move(shape),
                       .units = std::move(units),
                       .low = low,
                       .high = high});
  };
  const auto f32 = SensorType::float32;
  const std::vector<ExtraCamera> cameras = spec.all_cameras();
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const ExtraCamera& camera = cameras[i];
    const std::string prefix = camera.name.empty() ? "" : camera.name + "_";
    const int height = camera.config.height_px, width = camera.config.width_px;
    const std::size_t first = table.size();
    add(camera.depth, prefix + "depth", SensorKind::depth, f32, {height, width, 1}, "1", 0, 1);
    add(camera.rgb, prefix + "rgb", SensorKind::rgb, SensorType::uint8, {height, width, 3}, "1", 0, 255);
    add(camera.semantic, prefix + "semantic", SensorKind::semantic, SensorType::uint16, {height, width, 1}, "1", 0,
        static_cast<double>(category_names().size() - 1));
    add(camera.normals, prefix + "normals", SensorKind::normals, f32, {height, width, 3}, "1", -1, 1);
    for (std::size_t sensor = first; sensor < table.size(); ++sensor) table[sensor].camera = static_cast<int>(i);
  }
  const int channels = spec.hears() ? spec.layout().num_channels() : 0;
  add(spec.spectrogram, "spectrogram", SensorKind::spectrogram, f32, {spec.sound.rows(), spec.sound.columns(), channels}, "1", 0,
      kUnbounded);
  add(spec.interaural, "interaural", SensorKind::interaural, f32, {spec.sound.rows(), spec.sound.columns(), kInterauralChannels}, "1",
      -kUnbounded, kUnbounded);
  add(spec.waveform, "waveform", SensorKind::waveform, f32, {channels, step_samples}, "1", -kUnbounded, kUnbounded);
  add(spec.heard, "heard", SensorKind::heard, f32, {channels, spec.sound.num_samples}, "1", -kUnbounded, kUnbounded);
  add(spec.pointgoal, "pointgoal", SensorKind::pointgoal, f32, {2}, "m,rad", -kPi, kUnbounded);
  add(spec.gps_compass, "gps_compass", SensorKind::gps_compass, f32, {3}, "m,m,rad", -kUnbounded, kUnbounded);
  add(spec.pose, "pose", SensorKind::pose, f32, {4}, "m,m,rad,s", -kUnbounded, kUnbounded);
  add(spec.collision, "collision", SensorKind::collision, SensorType::uint8, {1}, "1", 0, 1);
  add(spec.previous_action, "previous_action", SensorKind::previous_action, SensorType::int32, {1}, "1", -1, kNumActions - 1);
  add(spec.topdown_map, "topdown_map", SensorKind::topdown_map, SensorType::uint8,
      {spec.map.size_px, spec.map.size_px, map_channels(spec.map)}, "1", 0, 255);
  add(spec.oracle_action, "oracle_action", SensorKind::oracle_action, SensorType::int32, {1}, "1", 0, kNumActions - 1);
  add(spec.goal_state, "goal_state", SensorKind::goal_state, f32, {4}, "m,m,rad,rad", -kPi, kUnbounded);
  for (SensorSpec& sensor : table) {
    const SensorSource source = source_of(sensor.kind);
    sensor.privileged = source == SensorSource::map || source == SensorSource::goal;
  }
  return table;
}

const SensorSpec* find_sensor(std::span<const SensorSpec> table, std::string_view name) {
  const auto found = std::find_if(table.begin(), table.end(), [&](const SensorSpec& sensor) { return sensor.name == name; });
  return found == table.end() ? nullptr : &*found;
}

}  // namespace earshot
