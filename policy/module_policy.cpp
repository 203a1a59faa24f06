// SPDX-License-Identifier: Apache-2.0
#include "policy/module_policy.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "envs/task/action.h"
#include "policy/module_trial.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

/// Numbers of state per env: a checkpoint holds them, and each worker's rollout.
constexpr std::int64_t kMaxStateNumbers = std::int64_t{1} << 20;

/// A part of a module's tree, so that its tensors have the names that they have there.
class ModulePart : public torch::nn::Module {};

/// The part of `root` under a dotted name, made where it is missing, and the name behind the last dot.
std::pair<torch::nn::Module*, std::string> place_of(torch::nn::Module& root, const std::string& name) {
  torch::nn::Module* part = &root;
  std::size_t begin = 0;
  for (std::size_t dot = name.find('.'); dot != std::string::npos; begin = dot + 1, dot = name.find('.', begin)) {
    const std::string step = name.substr(begin, dot - begin);
    const auto children = part->named_children();
    const auto* known = children.find(step);
    part = known != nullptr ? known->get() : part->register_module(step, std::make_shared<ModulePart>()).get();
  }
  return {part, name.substr(begin)};
}

std::vector<std::int64_t> joined(std::vector<std::int64_t> first, const std::vector<std::int64_t>& last) {
  first.insert(first.end(), last.begin(), last.end());
  return first;
}

std::string shape_text(c10::IntArrayRef sizes) { return sizes.empty() ? "a single number" : listed(sizes.vec(), "x"); }

}  // namespace

std::shared_ptr<const std::string> read_module_file(const std::filesystem::path& path) {
  if (std::error_code error; !std::filesystem::exists(path, error))
    throw InputError("policy.module " + path.string(), "does not exist", "write it with torch.jit.script(module).save(FILE)");
  return std::make_shared<const std::string>(read_regular_file(path, kMaxModuleBytes));
}

ModulePolicyImpl::ModulePolicyImpl(const ObservationSpec& spec, const PolicyConfig& config, std::shared_ptr<const std::string> file,
                                   const std::string& where)
    : PolicyNetworkImpl(config), module_(*file, where), file_(std::move(file)), where_(where), sensors_(sensor_table(spec, 1)) {
  std::erase_if(sensors_, [](const SensorSpec& sensor) { return is_for_learner(sensor.kind); });
  if (sensors_.empty()) throw InputError("sensors", "are all off, so the policy has no input", "switch on depth, spectrogram or pointgoal");
  for (const SensorSpec& sensor : sensors_)
    if (sensor.kind == SensorKind::waveform)
      throw InputError("observation." + sensor.name, "is not kept in the rollouts of a training",
                       "switch it off; heard holds the last second of sound");
  if (!module_.has("forward")) throw InputError(where_, "has no method forward", "write the module as docs/howto/own_network.md says");
  has_memory_ = module_.has("initial_state");
  has_sequence_ = module_.has("sequence");
  register_tensors();
  read_initial_state();
  try_out();
  has_passed_trial_ = true;
  eval();
}

void ModulePolicyImpl::register_tensors() {
  bool trains = false;
  for (const ScriptModule::NamedTensor& item : module_.tensors()) {
    const auto [part, name] = place_of(*this, "module." + item.name);
    if (item.is_parameter)
      part->register_parameter(name, item.tensor, item.tensor.requires_grad());
    else
      part->register_buffer(name, item.tensor);
    trains = trains || (item.is_parameter && item.tensor.requires_grad());
  }
  if (!trains) throw InputError(where_, "has no parameters that train", "script the module itself, not a frozen copy");
  if (!config_.normalize_values) return;
  value_weight_ = register_parameter("value_weight", torch::ones({1}));
  value_bias_ = register_parameter("value_bias", torch::zeros({1}));
  register_value_scale();
}

void ModulePolicyImpl::read_initial_state() {
  if (!has_memory_) return;
  try {
    const torch::Tensor initial = module_.constant("initial_state");
    if (initial.scalar_type() != torch::kFloat32 || initial.numel() == 0 || initial.numel() > kMaxStateNumbers || initial.dim() > 7 ||
        initial.dim() == 0)
      throw std::runtime_error(
          fmt::format("initial_state returns {} of {}; it is the state of one environment, float32 of 1 to {} numbers "
                      "in 1 to 7 dimensions",
                      shape_text(initial.sizes()), torch::toString(initial.scalar_type()), kMaxStateNumbers));
    state_shape_ = initial.sizes().vec();
    hidden_size_ = static_cast<int>(initial.numel());
  } catch (const std::runtime_error& error) {
    throw InputError(where_, error.what(), expected_inputs());
  }
}

std::string ModulePolicyImpl::expected_inputs() const {
  std::string text = "N rows of";
  for (const SensorSpec& sensor : sensors_)
    text += fmt::format(" {} Nx{} {},", sensor.name, listed(sensor.shape, "x"), name_of(sensor.type));
  return text + fmt::format(" and the state Nx{} come in (docs/howto/own_network.md)", listed(state_shape_, "x"));
}

ObservationTensors ModulePolicyImpl::seen(const ObservationTensors& observations, std::initializer_list<std::int64_t> leading) const {
  ObservationTensors rows;
  for (const SensorSpec& sensor : sensors_) rows.add(sensor.name, observations[sensor.name].reshape(sizes_of(sensor, leading)));
  if (const torch::Tensor& goal = observations["goal_state"]; config_.guided_critic && goal.defined())
    rows.add("goal_state", goal.reshape(joined(leading, {goal.size(-1)})));
  return rows;
}

torch::Tensor ModulePolicyImpl::initial_state() { return has_memory_ ? module_.constant("initial_state") : torch::zeros({1}); }

/// The state [N, ...] as the module has it, `initial` where an episode begins.
torch::Tensor ModulePolicyImpl::begin_state(const torch::Tensor& state, const torch::Tensor& not_done, const torch::Tensor& initial) const {
  const torch::Tensor shaped = state.reshape(joined({state.size(0)}, state_shape_));
  const torch::Tensor is_continuing = not_done.reshape(joined({state.size(0)}, std::vector<std::int64_t>(state_shape_.size(), 1))) > 0;
  return torch::where(is_continuing, shaped, initial.unsqueeze(0));  // not a product: 0 times NaN is NaN
}

PolicyOutput ModulePolicyImpl::sequence(const ObservationTensors& observations, const torch::Tensor& hidden,
                                        const torch::Tensor& not_done) {
  EARSHOT_EXPECT(hidden.size(0) == not_done.size(1) && hidden.size(1) == hidden_size_);
  try {
    return has_sequence_ && has_memory_ && config_.recurrent && not_done.size(0) > 1 ? whole_sequence(observations, hidden, not_done)
                                                                                     : by_steps(observations, hidden, not_done);
  } catch (const std::runtime_error& error) {
    if (has_passed_trial_) throw RunError(where_, error.what());
    std::string what = error.what();
    std::vector<std::string> missing;
    for (const std::string& name : module_.observations_read())
      if (!observations[name].defined()) missing.push_back("'" + name + "'");
    if (!missing.empty()) what = fmt::format("reads the observation {}, which is not on", listed(missing, ", "));
    throw InputError(where_, what, expected_inputs());
  }
}

PolicyOutput ModulePolicyImpl::whole_sequence(const ObservationTensors& observations, const torch::Tensor& hidden,
                                              const torch::Tensor& not_done) {
  const std::int64_t T = not_done.size(0), B = not_done.size(1);
  const torch::Tensor state = begin_state(hidden, not_done[0], initial_state());
  return checked("sequence", module_.call("sequence", seen(observations, {T, B}), state, not_done.eq(0)), {T, B});
}

/// Rows without memory of each other are one call.
PolicyOutput ModulePolicyImpl::by_steps(const ObservationTensors& observations, const torch::Tensor& hidden,
                                        const torch::Tensor& not_done) {
  const std::int64_t T = not_done.size(0), B = not_done.size(1);
  const bool is_memoryless = !has_memory_ || !config_.recurrent;
  const std::int64_t steps = is_memoryless ? 1 : T, rows = is_memoryless ? T * B : B;
  const torch::Tensor initial = initial_state();
  std::vector<torch::Tensor> logits, values, goals;
  torch::Tensor state = is_memoryless ? torch::zeros({rows, hidden_size_}) : hidden;
  for (std::int64_t t = 0; t < steps; ++t) {
    const ObservationTensors now = observations.map([&](const torch::Tensor& all) { return all.narrow(0, t * rows, rows); });
    const torch::Tensor start_state = begin_state(state, is_memoryless ? torch::zeros({rows}) : not_done[t], initial);
    const PolicyOutput output = checked("forward", module_.call("forward", seen(now, {rows}), start_state), {rows});
    logits.push_back(output.logits);
    values.push_back(output.value);
    if (output.goal.defined()) goals.push_back(output.goal);
    state = output.hidden;
  }
  return {.logits = torch::cat(logits),
          .value = torch::cat(values),
          .hidden = state.narrow(0, rows - B, B),
          .goal = goals.empty() ? torch::Tensor() : torch::cat(goals)};
}

/// The outputs of a method, each of the shape that is needed, in the form of PolicyOutput.
PolicyOutput ModulePolicyImpl::checked(const std::string& method, std::vector<torch::Tensor> outputs,
                                       std::vector<std::int64_t> leading) const {
  const std::size_t needed = config_.goal_heads ? 4 : 3;
  if (outputs.size() != needed)
    throw std::runtime_error(fmt::format("{} returns {} tensors; needed are {}: action logits, value, state{}", method, outputs.size(),
                                         needed, config_.goal_heads ? ", goal (policy.goal_heads)" : ""));
  const auto expect = [&](const char* name, const torch::Tensor& tensor, const std::vector<std::int64_t>& sizes) {
    if (tensor.sizes() != torch::IntArrayRef(sizes))
      throw std::runtime_error(
          fmt::format("{} returns {} of the shape {}; needed is {}", method, name, shape_text(tensor.sizes()), shape_text(sizes)));
    if (tensor.scalar_type() != torch::kFloat32)
      throw std::runtime_error(fmt::format("{} returns {} as {}; needed is Float", method, name, torch::toString(tensor.scalar_type())));
  };
  expect("action logits", outputs[0], joined(leading, {kNumActions}));
  if (outputs[1].dim() == std::ssize(leading) + 1 && outputs[1].size(-1) == 1) outputs[1] = outputs[1].squeeze(-1);
  expect("value", outputs[1], leading);
  expect("state", outputs[2], joined({leading.back()}, state_shape_));
  if (config_.goal_heads) expect("goal", outputs[3], joined(leading, {kGoalOutputs}));

  PolicyOutput output{.logits = outputs[0].reshape({-1, kNumActions}),
                      .value = outputs[1].reshape({-1}),
                      .hidden = outputs[2].reshape({leading.back(), hidden_size_})};
  if (config_.goal_heads) output.goal = outputs[3].reshape({-1, kGoalOutputs});
  if (config_.initial_stop_logit != 0) {
    torch::Tensor offset = torch::zeros({kNumActions});
    offset[static_cast<std::int64_t>(Action::stop)] = config_.initial_stop_logit;
    output.logits = output.logits + offset;
  }
  if (config_.normalize_values) output.value = scaled_value(output.value * value_weight_ + value_bias_);
  return output;
}

void ModulePolicyImpl::try_out() {
  std::vector<torch::Tensor> before;
  for (const torch::Tensor& buffer : buffers()) before.push_back(buffer.clone());
  if (const auto fault = fault_of_network(*this, sensors_, has_sequence_ && has_memory_))
    throw InputError(where_, *fault, expected_inputs());
  std::size_t i = 0;
  for (const auto& buffer : named_buffers())
    if (!torch::equal(before[i++], buffer.value()))
      throw InputError(where_, fmt::format("changes its buffer '{}' when it is called", buffer.key()), "keep what changes in the state");
}

void ModulePolicyImpl::set_value_scale(double mean, double deviation) { move_value_scale(mean, deviation, value_weight_, value_bias_); }

std::string ModulePolicyImpl::architecture() const {
  std::string line = fmt::format("module v1 {}:", hex64(hash64(*file_)));
  for (const SensorSpec& sensor : sensors_) line += fmt::format(" {} {},", sensor.name, listed(sensor.shape, "x"));
  line += fmt::format(" state {}, actions {}", listed(state_shape_, "x"), kNumActions);
  if (!config_.recurrent) line += " without memory";
  if (config_.initial_stop_logit != 0) line += fmt::format(", stop {:+g}", config_.initial_stop_logit);
  if (config_.guided_critic) line += ", guided critic";
  if (config_.goal_heads) line += ", goal heads";
  if (config_.normalize_values) line += ", normalized values";
  return line;
}

}  // namespace earshot
