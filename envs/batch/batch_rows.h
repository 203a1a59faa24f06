// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "envs/sensors/sensor.h"
#include "envs/sensors/sensor_rows.h"

namespace earshot {

/// The result of a step for one agent: its row of rewards and flags, once the step is over.
struct StepOutcome {
  float reward = 0;
  bool terminated = false, truncated = false, collided = false, quarantined = false, acted = false;
};

/// The buffers that a batch shows: rows of every sensor, rewards and flags.  A row is one agent of one env; all arrays are [rows, ...] and
/// are sized once.
///
/// Threads: calls that name a row may run at the same time for different rows.  Reading calls without a row need all of them at rest.
/// No call allocates after construction.
class BatchRows {
 public:
  /// Rows of all sensors of sensor_table(spec, block_samples).  Where a sensor hears, `waveform` and `heard` are kept too, as the others
  /// are made of them.
  BatchRows(const ObservationSpec& spec, int block_samples, std::size_t num_rows);
  BatchRows(const BatchRows&) = delete;  // by_kind_ points into it
  BatchRows& operator=(const BatchRows&) = delete;

  /// The observed sensors; it leaves out rows that are only kept.
  [[nodiscard]] std::span<const SensorSpec> table() const { return table_; }
  [[nodiscard]] std::size_t num_rows() const { return num_rows_; }
  /// Rows of a sensor, also of one that is only kept: bytes of [rows, shape].  Empty without this sensor.  O(sensors).
  [[nodiscard]] std::span<const std::byte> now(std::string_view sensor) const;
  /// The same of the observations in which the last episodes ended.
  [[nodiscard]] std::span<const std::byte> last(std::string_view sensor) const;
  /// The rows that a stage fills: of this kind and, for a picture, of this camera (index in ObservationSpec::all_cameras()).  Null where
  /// the sensor is off.  O(1).
  [[nodiscard]] SensorRows* of(SensorKind kind, int camera = -1) const {
    return by_kind_[static_cast<std::size_t>(camera + 1)][static_cast<std::size_t>(kind)];
  }

  /// Zeros the observation of a row.
  void clear(std::size_t row);
  /// Copies the observation of a row to its last observation.
  void keep(std::size_t row);

  /// Sets reward and flags of a row.
  void publish(std::size_t row, const StepOutcome& outcome, bool is_active);
  /// Zeros reward and flags of a row, but for `active`.
  void clear_outcome(std::size_t row);
  /// A row whose env leaves the batch: quarantined, truncated, inactive, both observations zero.
  void give_up(std::size_t row);

  [[nodiscard]] std::span<const float> rewards() const { return rewards_; }
  [[nodiscard]] std::span<const std::uint8_t> terminated() const { return terminated_; }
  [[nodiscard]] std::span<const std::uint8_t> truncated() const { return truncated_; }
  [[nodiscard]] std::span<const std::uint8_t> active() const { return active_; }
  [[nodiscard]] std::span<const std::uint8_t> collided() const { return collided_; }
  [[nodiscard]] std::span<const std::uint8_t> quarantined() const { return quarantined_; }
  [[nodiscard]] std::span<const std::uint8_t> acted() const { return acted_; }

 private:
  [[nodiscard]] const SensorRows* find(std::string_view sensor) const;

  std::vector<SensorSpec> table_;
  std::size_t num_rows_;
  std::vector<SensorRows> sensors_;  ///< as the table, then those that are only kept
  /// [1 + cameras][kind], first what no camera sees; null: off.
  std::vector<std::array<SensorRows*, kNumSensorKinds>> by_kind_;
  std::vector<float> rewards_;
  std::vector<std::uint8_t> terminated_, truncated_, active_, collided_, quarantined_, acted_;
};

}  // namespace earshot
