// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/resource_need.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <system_error>

#include "envs/sensors/sensor.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kProgramBytes = 100e6;  // private memory of a process with libtorch that has done nothing: 120 MB
constexpr double kStepSeconds = 0.25;    // of sound in a step, about
constexpr double kSlabs = 10;            // numbers of a row of a rollout beside the sensors (rollout_buffer.h)
constexpr double kCopiesOfWeights = 6;   // weights, gradient, two moments of Adam, the last whole update of two of them

double row_bytes(const ObservationSpec& spec, int step_samples) {
  double sum = 0;
  for (const SensorSpec& sensor : sensor_table(spec, step_samples)) sum += static_cast<double>(sensor.bytes());
  return sum;
}

/// Of the sound; 0 without a sensor that hears.
double sound_channels(const ObservationSpec& spec) { return spec.hears() ? spec.layout().num_channels() : 0; }

std::string in_words(double bytes) {
  return bytes < 1e9    ? fmt::format("{:.0f} MB", bytes / 1e6)
         : bytes < 1e13 ? fmt::format("{:.1f} GB", bytes / 1e9)
                        : fmt::format("{:.3g} GB", bytes / 1e9);
}

/// The keys that take most, with their values.
std::string largest_part(const RunConfig& config, const ResourceNeed& need) {
  struct Part {
    double bytes;
    std::string key;
  };
  const std::array parts{
      Part{need.program_bytes, fmt::format("workers = {}", need.processes)},
      Part{need.environment_bytes, fmt::format("envs_per_worker = {}", config.envs_per_worker)},
      Part{need.rollout_bytes, fmt::format("rollout_steps = {} with envs_per_worker = {}", config.rollout_steps, config.envs_per_worker)},
      Part{need.learner_bytes, config.policy.module.empty() ? fmt::format("policy.hidden_size = {}", config.policy.hidden_size)
                                                            : "policy.module = " + config.policy.module}};
  return std::ranges::max_element(parts, {}, &Part::bytes)->key;
}

/// 0 where there is none, which is said when it is read.
double bytes_of_file(const std::filesystem::path& path) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  return error ? 0 : static_cast<double>(bytes);
}

}  // namespace

ResourceNeed resource_need(const RunConfig& config, int processes) {
  const double envs = config.envs_per_worker, held_out = config.held_out.is_on() ? config.eval_envs : 0, steps = config.rollout_steps,
               hidden = config.policy.hidden_size;
  const double features = static_cast<double>(config.policy.visual_features) + config.policy.audio_features;
  const double rate = static_cast<double>(config.env.acoustics.sample_rate_hz);
  const ObservationSpec sensors = training_sensors(config);
  ResourceNeed need;
  need.processes = processes;
  need.program_bytes = kProgramBytes;
  const double response = sound_channels(sensors) * sizeof(float) * rate * static_cast<double>(config.env.acoustics.rir_length_s);
  need.environment_bytes = (envs + held_out) * (row_bytes(sensors, static_cast<int>(kStepSeconds * rate)) + response);
  need.rollout_bytes = envs * (steps * (row_bytes(sensors, 1) + kSlabs * sizeof(float)) + hidden * sizeof(float));
  const double module_bytes = config.policy.module.empty() ? 0 : bytes_of_file(config.policy.module);
  if (module_bytes > 0)
    need.learner_bytes = kCopiesOfWeights * module_bytes;  // nearly all of it are weights
  else
    need.learner_bytes = kCopiesOfWeights * sizeof(float) * 3 * hidden * (hidden + features);  // of a GRU
  return need;
}

void refuse_beyond_machine(const RunConfig& config, int processes, const MachineLimits& machine) {
  constexpr const char* remedy = "lower it, take a larger machine, or insist with --force";
  if (processes > kWorkersPerCore * machine.cores)
    throw InputError(fmt::format("{} workers", processes),
                     fmt::format("are more than this machine can run: it has {} cores, for {} workers at most", machine.cores,
                                 kWorkersPerCore * machine.cores),
                     remedy);
  const ResourceNeed need = resource_need(config, processes);
  const double address_space = need.worker_bytes() + static_cast<double>(machine.mapped_bytes + kWorkingBytes);
  std::string excess;
  if (machine.memory_bytes > 0 && need.bytes() > static_cast<double>(machine.memory_bytes))
    excess = fmt::format("{} with at least {} each; the machine has {}", processes == 1 ? "1 worker" : fmt::format("{} workers", processes),
                         in_words(need.worker_bytes()), in_words(static_cast<double>(machine.memory_bytes)));
  else if (machine.process_bytes > 0 && address_space > static_cast<double>(machine.process_bytes))
    excess = fmt::format("a worker with at least {} of address space, its libraries among it; the limit (ulimit -v) is {}",
                         in_words(address_space), in_words(static_cast<double>(machine.process_bytes)));
  if (excess.empty()) return;
  throw InputError(largest_part(config, need), "needs more memory than there is: " + excess, remedy);
}

}  // namespace earshot
