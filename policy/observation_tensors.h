// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "envs/sensors/sensor.h"

namespace earshot {

/// Observations of a batch by the name of their sensor (sensor_table), any leading dimensions before those of a row: [N, shape] or
/// [T, B, shape].  A sensor that is off has no entry.
struct ObservationTensors {
  struct Entry {
    std::string name;
    torch::Tensor rows;
  };
  std::vector<Entry> sensors;

  ObservationTensors() = default;
  ObservationTensors(std::initializer_list<Entry> entries) : sensors(entries) {}

  /// The sensor's tensor; undefined if it is missing.
  [[nodiscard]] const torch::Tensor& operator[](std::string_view name) const;
  /// The tensor of a sensor that is there.
  [[nodiscard]] torch::Tensor& at(std::string_view name);
  void add(std::string name, torch::Tensor rows) { sensors.push_back({std::move(name), std::move(rows)}); }
  /// The same sensors with change(rows) for each.
  template <class Change>
  [[nodiscard]] ObservationTensors map(const Change& change) const {
    ObservationTensors changed;
    changed.sensors.reserve(sensors.size());
    for (const Entry& entry : sensors) changed.sensors.push_back({entry.name, change(entry.rows)});
    return changed;
  }
};

/// The dtype of a sensor's numbers.
torch::ScalarType scalar_type(SensorType type);
/// The sizes of its rows behind `leading` dimensions.
std::vector<std::int64_t> sizes_of(const SensorSpec& sensor, std::initializer_list<std::int64_t> leading);

}  // namespace earshot
