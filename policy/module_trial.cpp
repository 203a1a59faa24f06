// SPDX-License-Identifier: Apache-2.0
#include "policy/module_trial.h"

#include <torch/utils.h>

#include <cmath>
#include <exception>
#include <stdexcept>
#include <vector>

#include "envs/task/action.h"

namespace earshot {
namespace {

constexpr std::int64_t kSteps = 3, kRows = 2;

/// Numbers in [0, 1) without a pattern that a network could meet by its own: multiples of an irrational number (Weyl 1916).
torch::Tensor drawn(const SensorSpec& sensor, std::int64_t rows, double start) {
  const torch::Tensor fractions =
      (torch::arange(rows * static_cast<std::int64_t>(sensor.count()), torch::kFloat64) * 0.7548776662466927 + start)
          .frac()
          .reshape(sizes_of(sensor, {rows}));
  if (sensor.kind == SensorKind::previous_action) return (fractions * (kNumActions + 1)).floor().to(torch::kInt32) - 1;
  if (sensor.type == SensorType::float32) return fractions.to(torch::kFloat32);
  return (fractions * (sensor.type == SensorType::uint8 ? 256 : 8)).to(scalar_type(sensor.type));
}

ObservationTensors drawn_rows(std::span<const SensorSpec> sensors, std::int64_t rows) {
  ObservationTensors observations;
  double start = 0.1;
  for (const SensorSpec& sensor : sensors) observations.add(sensor.name, drawn(sensor, rows, start += 0.31));
  return observations;
}

/// Of two tensors in the unit of the second; infinite where one is not finite.
double difference(const torch::Tensor& one, const torch::Tensor& other) {
  if (one.numel() == 0) return 0;
  const double largest = ((one - other).abs() / (1 + other.abs())).max().item<double>();
  return std::isfinite(largest) ? largest : HUGE_VAL;
}

double difference(const PolicyOutput& one, const PolicyOutput& other) {
  return std::max({difference(one.logits, other.logits), difference(one.value, other.value), difference(one.hidden, other.hidden)});
}

PolicyOutput row_of(const PolicyOutput& output, std::int64_t row) {
  return {.logits = output.logits.narrow(0, row, 1), .value = output.value.narrow(0, row, 1), .hidden = output.hidden.narrow(0, row, 1)};
}

std::optional<std::string> fault_of_steps(PolicyNetworkImpl& network, const ObservationTensors& rows) {
  const torch::NoGradGuard no_gradient;
  const std::int64_t count = kSteps * kRows;
  torch::Tensor hidden = torch::zeros({count, network.hidden_size()});
  hidden = network.step(rows, hidden, torch::zeros({count})).hidden;  // a state that an episode has reached
  const torch::Tensor is_continuing = torch::ones({count});
  const PolicyOutput first = network.step(rows, hidden, is_continuing), again = network.step(rows, hidden, is_continuing);
  for (const torch::Tensor& tensor : {first.logits, first.value, first.hidden})
    if (!torch::isfinite(tensor).all().item<bool>()) return "returns numbers that are not finite for ordinary observations";
  if (!torch::equal(first.logits, again.logits) || !torch::equal(first.value, again.value) || !torch::equal(first.hidden, again.hidden))
    return "returns other numbers in a second call with the same inputs";
  const std::int64_t row = 1;
  const PolicyOutput alone = network.step(rows.map([&](const torch::Tensor& all) { return all.narrow(0, row, 1); }),
                                          hidden.narrow(0, row, 1), is_continuing.narrow(0, row, 1));
  if (difference(alone, row_of(first, row)) > kMaxTrialError) return "returns other numbers for a row alone than for it among others";
  return std::nullopt;
}

/// The second env begins an episode in the middle.
std::optional<std::string> fault_of_sequence(PolicyNetworkImpl& network, const ObservationTensors& rows) {
  const torch::NoGradGuard no_gradient;
  torch::Tensor not_done = torch::ones({kSteps, kRows}), hidden = torch::zeros({kRows, network.hidden_size()});
  not_done[0].zero_();
  not_done[1][1] = 0;
  const PolicyOutput whole = network.sequence(rows, hidden, not_done);
  PolicyOutput step;
  for (std::int64_t t = 0; t < kSteps; ++t) {
    step = network.step(rows.map([&](const torch::Tensor& all) { return all.narrow(0, t * kRows, kRows); }), hidden, not_done[t]);
    const double error = std::max(difference(whole.logits.narrow(0, t * kRows, kRows), step.logits),
                                  difference(whole.value.narrow(0, t * kRows, kRows), step.value));
    if (error > kMaxTrialError)
      return "returns other numbers from sequence than from forward step by step, where episodes begin at step 0 and, in one row, at step "
             "1";
    hidden = step.hidden;
  }
  if (difference(whole.hidden, step.hidden) > kMaxTrialError)
    return "returns another last state from sequence than from forward step by step";
  return std::nullopt;
}

std::optional<std::string> fault_of_gradient(PolicyNetworkImpl& network, const ObservationTensors& rows) {
  const PolicyOutput output = network.sequence(rows, torch::zeros({kRows, network.hidden_size()}), torch::ones({kSteps, kRows}));
  if (!output.logits.requires_grad()) return "returns action logits that no parameter has a part in";
  if (!output.value.requires_grad()) return "returns a value that no parameter has a part in";
  try {
    (output.logits.sum() + output.value.sum()).backward();
  } catch (const std::exception&) {
    return "cannot be differentiated: an operation in place changes what the gradient needs";
  }
  for (torch::Tensor& parameter : network.parameters()) parameter.mutable_grad() = torch::Tensor();
  return std::nullopt;
}

}  // namespace

std::optional<std::string> fault_of_network(PolicyNetworkImpl& network, std::span<const SensorSpec> sensors, bool has_sequence) {
  const ObservationTensors rows = drawn_rows(sensors, kSteps * kRows);
  std::optional<std::string> fault = fault_of_steps(network, rows);
  if (!fault && has_sequence) fault = fault_of_sequence(network, rows);
  return fault ? fault : fault_of_gradient(network, rows);
}

}  // namespace earshot
