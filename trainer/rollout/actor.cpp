// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/actor.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/base/denormals.h"

namespace earshot {
namespace {

/// final: the last observations of the episodes that just ended.
ObservationTensors views(const BatchedEnv& env, bool final) {
  ObservationTensors tensors;
  const std::span<const SensorSpec> table = env.sensors();
  tensors.sensors.reserve(table.size());
  for (const SensorSpec& sensor : table) {
    const std::span<const std::byte> rows = final ? env.final_rows(sensor.name) : env.rows(sensor.name);
    // from_blob wants a mutable pointer; no caller writes through these views.
    tensors.sensors.push_back(
        {sensor.name, torch::from_blob(const_cast<std::byte*>(rows.data()), sizes_of(sensor, {env.num_rows()}), scalar_type(sensor.type))});
  }
  return tensors;
}

ObservationTensors rows_of(const ObservationTensors& observations, int first, int count) {
  return observations.map([&](const torch::Tensor& rows) { return rows.narrow(0, first, count); });
}

bool row_is_finite(const torch::Tensor& rows, std::int64_t row) {
  if (!rows.is_floating_point()) return true;
  const std::int64_t size = rows.numel() / rows.size(0);
  const float* values = rows.data_ptr<float>() + row * size;
  return std::all_of(values, values + size, [](float value) { return std::isfinite(value); });
}

/// Sets rows that are not finite to zero, in a copy, and marks them.
void sanitize(ObservationTensors& observations, std::vector<std::uint8_t>& sanitized) {
  for (auto& [name, rows] : observations.sensors) {
    bool copied = false;
    for (std::int64_t row = 0; row < rows.size(0); ++row) {
      if (row_is_finite(rows, row)) continue;
      if (!copied) rows = rows.clone();  // the env's buffer is not ours to write
      copied = true;
      rows[row].zero_();
      sanitized[static_cast<std::size_t>(row)] = 1;
    }
  }
}

/// The value of a sanitized observation belongs to no state.
void discard_sanitized_values(torch::Tensor& value, const std::vector<std::uint8_t>& sanitized) {
  for (std::size_t row = 0; row < sanitized.size(); ++row)
    if (sanitized[row]) value[static_cast<std::int64_t>(row)] = std::numeric_limits<float>::quiet_NaN();
}

}  // namespace

ObservationTensors observation_tensors(const BatchedEnv& env) { return views(env, false); }

ObservationTensors final_observation_tensors(const BatchedEnv& env) { return views(env, true); }

Actor::Actor(PolicyNetwork policy, int first_row, int num_rows)
    : policy_(std::move(policy)),
      first_row_(first_row),
      num_rows_(num_rows),
      hidden_(torch::zeros({num_rows, policy_->hidden_size()})),
      not_done_(torch::zeros({num_rows})),
      sanitized_(static_cast<std::size_t>(num_rows), 0) {}

const PolicyOutput& Actor::observe(const BatchedEnv& env) { return observe(rows_of(observation_tensors(env), first_row_, num_rows_)); }

const PolicyOutput& Actor::observe(const ObservationTensors& observations) {
  const torch::NoGradGuard no_grad;
  const FlushDenormals flush;
  std::fill(sanitized_.begin(), sanitized_.end(), std::uint8_t{0});
  seen_ = observations;
  sanitize(seen_, sanitized_);
  output_ = policy_->step(seen_, hidden_, not_done_);
  bool again = false;
  for (std::int64_t row = 0; row < output_.logits.size(0); ++row) {
    if (row_is_finite(output_.logits, row) && row_is_finite(output_.value, row) && row_is_finite(output_.hidden, row)) continue;
    for (auto& [name, rows] : seen_.sensors) rows = rows.index_fill(0, torch::tensor({row}), 0);
    hidden_[row].zero_();
    not_done_[row] = 0;
    sanitized_[static_cast<std::size_t>(row)] = 1;
    again = true;
  }
  if (again) output_ = policy_->step(seen_, hidden_, not_done_);
  for (const std::uint8_t sanitized : sanitized_) sanitized_rows_ += sanitized;
  discard_sanitized_values(output_.value, sanitized_);
  return output_;
}

torch::Tensor Actor::truncated_values(const BatchedEnv& env) {
  torch::Tensor values = torch::zeros({num_rows_});
  std::vector<std::int64_t> rows;
  for (int i = 0; i < num_rows_; ++i) {
    const auto row = static_cast<std::size_t>(first_row_ + i);
    if (env.truncated()[row] != 0 && env.terminated()[row] == 0) rows.push_back(i);
  }
  if (rows.empty()) return values;
  const torch::NoGradGuard no_grad;
  const FlushDenormals flush;
  const torch::Tensor index = torch::tensor(rows);
  ObservationTensors last = rows_of(final_observation_tensors(env), first_row_, num_rows_).map([&](const torch::Tensor& rows_of_sensor) {
    return rows_of_sensor.index_select(0, index);
  });
  const auto count = static_cast<std::int64_t>(rows.size());
  std::vector<std::uint8_t> sanitized(rows.size(), 0);
  sanitize(last, sanitized);
  PolicyOutput output = policy_->step(last, output_.hidden.index_select(0, index), torch::ones({count}));
  discard_sanitized_values(output.value, sanitized);
  values.index_copy_(0, index, output.value);
  return values;
}

void Actor::advance(const BatchedEnv& env) {
  hidden_ = output_.hidden;
  for (int i = 0; i < num_rows_; ++i) {
    const auto row = static_cast<std::size_t>(first_row_ + i);
    not_done_[i] = env.terminated()[row] != 0 || env.truncated()[row] != 0 ? 0.f : 1.f;
  }
}

torch::Tensor Actor::peek_value(const BatchedEnv& env) {
  const torch::NoGradGuard no_grad;
  const FlushDenormals flush;
  ObservationTensors now = rows_of(observation_tensors(env), first_row_, num_rows_);
  std::vector<std::uint8_t> sanitized(sanitized_.size(), 0);
  sanitize(now, sanitized);
  torch::Tensor value = policy_->step(now, hidden_, not_done_).value;
  discard_sanitized_values(value, sanitized);
  return value;
}

void Actor::restore(const torch::Tensor& hidden, const torch::Tensor& not_done) {
  hidden_ = hidden.clone();
  not_done_ = not_done.clone();
}

}  // namespace earshot
