// SPDX-License-Identifier: Apache-2.0
#include "policy/observation_tensors.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {
namespace {

template <class Entries>
auto find(Entries& entries, std::string_view name) {
  return std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.name == name; });
}

}  // namespace

const torch::Tensor& ObservationTensors::operator[](std::string_view name) const {
  static const torch::Tensor undefined;
  const auto found = find(sensors, name);
  return found == sensors.end() ? undefined : found->rows;
}

torch::Tensor& ObservationTensors::at(std::string_view name) {
  const auto found = find(sensors, name);
  EARSHOT_EXPECT(found != sensors.end());
  return found->rows;
}

torch::ScalarType scalar_type(SensorType type) {
  switch (type) {
    case SensorType::uint8:
      return torch::kUInt8;
    case SensorType::uint16:
      return torch::kInt16;  // libtorch has no uint16; there are fewer categories than 2^15
    case SensorType::int32:
      return torch::kInt32;
    case SensorType::float32:
      break;
  }
  return torch::kFloat32;
}

std::vector<std::int64_t> sizes_of(const SensorSpec& sensor, std::initializer_list<std::int64_t> leading) {
  std::vector<std::int64_t> sizes(leading);
  sizes.insert(sizes.end(), sensor.shape.begin(), sensor.shape.end());
  return sizes;
}

}  // namespace earshot
