// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "envs/sensors/sensor.h"

namespace earshot {

/// One sensor of all envs of a batch, and its last values of the episodes that ended.
class SensorRows {
 public:
  SensorRows(SensorSpec spec, std::size_t num_envs)
      : spec_(std::move(spec)), row_bytes_(spec_.bytes()), now_(num_envs * row_bytes_), last_(now_.size()) {}

  [[nodiscard]] const SensorSpec& spec() const { return spec_; }
  [[nodiscard]] std::span<const std::byte> now() const { return now_; }
  [[nodiscard]] std::span<const std::byte> last() const { return last_; }
  /// The row of one env as numbers of the sensor's type.
  template <class T>
  [[nodiscard]] std::span<T> row(std::size_t env) {
    return {reinterpret_cast<T*>(now_.data() + env * row_bytes_), row_bytes_ / sizeof(T)};
  }
  /// The same of the last values of the episode that ended.
  template <class T>
  [[nodiscard]] std::span<T> last_row(std::size_t env) {
    return {reinterpret_cast<T*>(last_.data() + env * row_bytes_), row_bytes_ / sizeof(T)};
  }
  void keep(std::size_t env) { std::copy_n(now_.begin() + offset(env), row_bytes_, last_.begin() + offset(env)); }
  void clear(std::size_t env) { std::fill_n(now_.begin() + offset(env), row_bytes_, std::byte{0}); }

 private:
  [[nodiscard]] std::ptrdiff_t offset(std::size_t env) const { return static_cast<std::ptrdiff_t>(env * row_bytes_); }

  SensorSpec spec_;
  std::size_t row_bytes_;
  std::vector<std::byte> now_, last_;
};

}  // namespace earshot
