// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/batch_rows.h"

#include <algorithm>
#include <iterator>

namespace earshot {
namespace {

/// Sensors of sound that are not observed, and whose rows others are made of.
std::vector<SensorSpec> kept_sensors(const ObservationSpec& spec, int block_samples) {
  ObservationSpec kept;
  kept.depth = kept.spectrogram = false;
  kept.waveform = spec.hears() && !spec.waveform;
  kept.heard = spec.hears() && !spec.heard;
  kept.sound = spec.sound;
  kept.channels = spec.channels;
  return sensor_table(kept, block_samples);
}

}  // namespace

BatchRows::BatchRows(const ObservationSpec& spec, int block_samples, std::size_t num_rows)
    : table_(sensor_table(spec, block_samples)), num_rows_(num_rows), by_kind_(1 + spec.all_cameras().size()) {
  std::vector<SensorSpec> all = table_;
  std::ranges::move(kept_sensors(spec, block_samples), std::back_inserter(all));
  sensors_.reserve(all.size());  // by_kind_ points into it
  for (SensorSpec& sensor : all) {
    const auto camera = static_cast<std::size_t>(sensor.camera + 1), kind = static_cast<std::size_t>(sensor.kind);
    by_kind_[camera][kind] = &sensors_.emplace_back(std::move(sensor), num_rows);
  }
  rewards_.assign(num_rows, 0.f);
  for (auto* flags : {&terminated_, &truncated_, &active_, &collided_, &quarantined_, &acted_}) flags->assign(num_rows, 0);
}

const SensorRows* BatchRows::find(std::string_view sensor) const {
  const auto found = std::ranges::find_if(sensors_, [&](const SensorRows& rows) { return rows.spec().name == sensor; });
  return found == sensors_.end() ? nullptr : &*found;
}

std::span<const std::byte> BatchRows::now(std::string_view sensor) const {
  const SensorRows* rows = find(sensor);
  return rows ? rows->now() : std::span<const std::byte>{};
}

std::span<const std::byte> BatchRows::last(std::string_view sensor) const {
  const SensorRows* rows = find(sensor);
  return rows ? rows->last() : std::span<const std::byte>{};
}

void BatchRows::clear(std::size_t row) {
  for (SensorRows& sensor : sensors_) sensor.clear(row);
}

void BatchRows::keep(std::size_t row) {
  for (SensorRows& sensor : sensors_) sensor.keep(row);
}

void BatchRows::publish(std::size_t row, const StepOutcome& outcome, bool is_active) {
  rewards_[row] = outcome.reward;
  terminated_[row] = outcome.terminated;
  truncated_[row] = outcome.truncated;
  collided_[row] = outcome.collided;
  quarantined_[row] = outcome.quarantined;
  acted_[row] = outcome.acted;
  active_[row] = is_active;
}

void BatchRows::clear_outcome(std::size_t row) { publish(row, {}, active_[row] != 0); }

void BatchRows::give_up(std::size_t row) {
  publish(row, {.truncated = true, .quarantined = true}, false);
  clear(row);
  keep(row);
}

}  // namespace earshot
