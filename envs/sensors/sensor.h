// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "envs/sensors/observation.h"

namespace earshot {

/// Kinds of sensors.  Shapes are those of one row.
enum class SensorKind : std::uint8_t {
  depth,        ///< float32 [height, width, 1], as CameraImages::depth
  rgb,          ///< uint8 [height, width, 3], as CameraImages::rgb
  semantic,     ///< uint16 [height, width, 1], as CameraImages::semantic
  normals,      ///< float32 [height, width, 3], as CameraImages::normals
  spectrogram,  ///< float32 [rows, columns, channels], log(1 + magnitude) of the last second, left and right ear or other channels
  interaural,   ///< float32 [rows, columns, 4]: level, and differences of level and phase between the ears (interaural_spectrogram.h)
  waveform,     ///< float32 [channels, samples of a step]: sound in this step, at the left and the right ear or of other channels
  heard,        ///< float32 [channels, samples of a second]: sound in the last second
  pointgoal,    ///< float32 [2], privileged: horizontal distance to the goal in metres, and its bearing in radians, counter-clockwise from
                ///< ahead
  gps_compass,  ///< float32 [3]: metres ahead of and to the right of the start, as it faced, and radians turned since, in [-pi, pi]
  pose,         ///< float32 [4]: as gps_compass, then the seconds since the start
  collision,    ///< uint8 [1]: 1 where the last step met an obstacle
  previous_action,  ///< int32 [1]: the last action; -1 before the first
  topdown_map,      ///< uint8 [size, size, channels], privileged, as draw_topdown_map: the walkable surface, the path, the agent, the goals
  oracle_action,    ///< int32 [1], privileged: action of the oracle
  goal_state,  ///< float32 [4], privileged: metres to the goal on foot and in a straight line; bearings of the goal and of the next corner
               ///< on the way to it in radians, counter-clockwise from ahead
};
inline constexpr std::size_t kNumSensorKinds = static_cast<std::size_t>(SensorKind::goal_state) + 1;

/// Source of a sensor's readings.
enum class SensorSource : std::uint8_t {
  eyes,      ///< camera images: depth, colours
  ears,      ///< the sound at the ears
  body,      ///< the last action, and whether it met an obstacle
  odometry,  ///< where the agent is relative to its start
  labels,    ///< ground truth of the simulator: categories, normals
  map,       ///< the plan of the scene
  goal,      ///< where the goal is
};
SensorSource source_of(SensorKind kind);
/// A label or a critic's input, which policies do not read.
bool is_for_learner(SensorKind kind);
std::string_view name_of(SensorSource source);

enum class SensorType : std::uint8_t { float32, uint8, uint16, int32 };
std::size_t size_of(SensorType type);
std::string_view name_of(SensorType type);

/// One sensor of an environment: a row of its table.  Environments, buffers and policies loop over the table; they name only sensors with
/// their own stage or encoder.
struct SensorSpec {
  std::string name;  ///< unique in the table; the key of observations
  SensorKind kind = SensorKind::depth;
  SensorType type = SensorType::float32;
  std::vector<int> shape;    ///< of one row
  std::string units;         ///< "m", "rad", "1"; of sensors that mix units, one for each number: "m,rad"
  double low = 0, high = 0;  ///< closed range of the values, infinite where there is no bound
  int camera = -1;           ///< of a picture: index in ObservationSpec::all_cameras()
  bool privileged = false;   ///< derived from the goal or the map (source_of): no agent could sense it

  [[nodiscard]] std::size_t count() const;  ///< numbers in a row
  [[nodiscard]] std::size_t bytes() const { return count() * size_of(type); }
  friend bool operator==(const SensorSpec&, const SensorSpec&) = default;
};

/// The sensors that `spec` switches on: those of the main camera, of the further ones, of sound, of the way.  step_samples: new samples of
/// sound in a step.
std::vector<SensorSpec> sensor_table(const ObservationSpec& spec, int step_samples);
/// The row of the table with this name; null if there is none.
const SensorSpec* find_sensor(std::span<const SensorSpec> table, std::string_view name);

/// Rows of a sensor of float32 as floats.
inline std::span<const float> as_floats(std::span<const std::byte> rows) {
  return {reinterpret_cast<const float*>(rows.data()), rows.size() / sizeof(float)};
}

}  // namespace earshot
