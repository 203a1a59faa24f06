// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "api/convert.h"
#include "api/episode_set_model.h"
#include "api/input_files.h"
#include "api/navigation_model.h"
#include "api/vector_env_model.h"
#include "earshot/env.h"
#include "envs/config/batch_config.h"
#include "sim/base/errors.h"

namespace earshot::api {

static_assert(static_cast<int>(SensorType::float32) == static_cast<int>(earshot::SensorType::float32) &&
              static_cast<int>(SensorType::uint8) == static_cast<int>(earshot::SensorType::uint8) &&
              static_cast<int>(SensorType::uint16) == static_cast<int>(earshot::SensorType::uint16) &&
              static_cast<int>(SensorType::int32) == static_cast<int>(earshot::SensorType::int32));
static_assert(kNumActions == earshot::kNumActions && static_cast<int>(Action::right) == static_cast<int>(earshot::Action::right));

namespace {

std::unique_ptr<VectorEnv::Model> make_batch(const Config& config, const VectorEnvOptions& options, int num_envs,
                                             std::shared_ptr<const earshot::EpisodeSet> episodes) {
  require(num_envs >= 1 && num_envs <= 65536, "num_envs", num_envs, "must be in [1, 65536]");
  require(options.first_env >= 0 && options.first_env <= 1'000'000'000, "first_env", options.first_env, "must be in [0, 1e9]");
  const timespec made_after = file_time_now();
  const BatchParts parts =
      read_batch(config.yaml, config.where, config.overrides.texts(), options.settings.texts(), options.split, std::move(episodes));
  auto model = std::make_unique<VectorEnv::Model>(
      VectorEnv::Model{.env = BatchedEnv(parts.config, parts.set, parts.scenes, num_envs, options.first_env, num_envs + options.first_env),
                       .sensors = {},
                       .set = parts.set,
                       .made_after = made_after});
  for (const SensorSpec& spec : model->env.sensors())
    model->sensors.push_back({.name = spec.name,
                              .type = static_cast<SensorType>(spec.type),
                              .shape = spec.shape,
                              .units = spec.units,
                              .low = spec.low,
                              .high = spec.high,
                              .privileged = spec.privileged});
  return model;
}

constexpr std::uint64_t kLargestInt = std::numeric_limits<int>::max();

RecvOrder order_of(bool as_sent) { return as_sent ? RecvOrder::as_sent : RecvOrder::as_ready; }

EpisodeResult result_of(const FinishedEpisode& episode) {
  const EpisodeMetrics& m = episode.metrics;
  return {.env = episode.env,
          .agent = episode.agent,
          .episode_index = episode.episode_index,
          .success = m.success,
          .spl = m.spl,
          .soft_spl = m.soft_spl,
          .sna = m.sna,
          .distance_to_goal_m = m.dtg_m,
          .success_when_silent = m.success_when_silent,
          .episode_return = m.reward,
          .steps = m.steps,
          .collisions = m.collisions,
          .stopped = m.stopped};
}

}  // namespace

std::size_t SensorInfo::count() const {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1},
                         [](std::size_t product, int size) { return product * static_cast<std::size_t>(size); });
}

VectorEnv::VectorEnv(const Config& config, int num_envs, const VectorEnvOptions& options)
    : model_(make_batch(config, options, num_envs, nullptr)) {}
VectorEnv::VectorEnv(const Config& config, const EpisodeSet& episodes, int num_envs, const VectorEnvOptions& options)
    : model_(make_batch(config, options, num_envs, episodes.model()->set)) {}
VectorEnv::~VectorEnv() = default;
VectorEnv::VectorEnv(VectorEnv&&) noexcept = default;
VectorEnv& VectorEnv::operator=(VectorEnv&&) noexcept = default;

void VectorEnv::reset() { model_->env.reset(); }
void VectorEnv::reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds) { model_->env.reset(mask, seeds); }
void VectorEnv::begin_episode(int env, std::uint64_t index) {
  if (const auto fault = model_->env.begin(env, index, static_cast<int>(std::min<std::uint64_t>(index, kLargestInt)), 0)) {
    const earshot::Episode& episode = model_->set->episodes[index];
    throw InputError("episode '" + episode.episode_id + "' in " + episode.scene_id, fault->detail,
                     "restore the missing files, or correct it");
  }
}
void VectorEnv::place(int env, const AgentPose& pose, int steps) {
  require_finite(pose.position, "place");
  require(std::isfinite(pose.heading_rad), "place", pose.heading_rad, "must have a finite heading");
  model_->env.place(env, {glm_of(pose.position), pose.heading_rad}, steps);
}
void VectorEnv::step(std::span<const std::int32_t> actions) { model_->env.step(actions); }
void VectorEnv::send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions) { model_->env.send(envs, actions); }
void VectorEnv::wait_ready(int min_ready, bool as_sent) { model_->env.wait_ready(min_ready, order_of(as_sent)); }
bool VectorEnv::works_in_background() const { return model_->env.works_in_background(); }
std::vector<std::int32_t> VectorEnv::recv(int min_ready, bool as_sent) {
  const std::span<const std::int32_t> ready = model_->env.recv(min_ready, order_of(as_sent));
  return {ready.begin(), ready.end()};
}

int VectorEnv::num_envs() const { return model_->env.num_envs(); }
int VectorEnv::num_agents() const { return model_->env.config().agents; }
int VectorEnv::num_rows() const { return model_->env.num_rows(); }
std::string VectorEnv::autoreset() const {
  switch (model_->env.config().autoreset) {
    case Autoreset::next_step:
      return "next_step";
    case Autoreset::off:
      return "off";
    case Autoreset::same_step:
      break;
  }
  return "same_step";
}
std::string VectorEnv::config_text() const { return earshot::config_text(model_->env.config()); }

const std::vector<SensorInfo>& VectorEnv::sensors() const { return model_->sensors; }
std::span<const std::byte> VectorEnv::rows(std::string_view sensor) const { return model_->env.rows(sensor); }
std::span<const std::byte> VectorEnv::final_rows(std::string_view sensor) const { return model_->env.final_rows(sensor); }
std::span<const std::byte> VectorEnv::typed_rows(std::string_view sensor, SensorType type) const {
  const SensorSpec* spec = find_sensor(model_->env.sensors(), sensor);
  if (spec == nullptr) throw std::invalid_argument(fmt::format("there is no sensor '{}'", sensor));
  if (static_cast<SensorType>(spec->type) != type)
    throw std::invalid_argument(fmt::format("sensor '{}' has numbers of type {}", sensor, name_of(spec->type)));
  return model_->env.rows(sensor);
}

std::span<const float> VectorEnv::rewards() const { return model_->env.rewards(); }
std::span<const std::uint8_t> VectorEnv::terminated() const { return model_->env.terminated(); }
std::span<const std::uint8_t> VectorEnv::truncated() const { return model_->env.truncated(); }
std::span<const std::uint8_t> VectorEnv::active() const { return model_->env.active(); }
std::span<const std::uint8_t> VectorEnv::collided() const { return model_->env.collided(); }
std::span<const std::uint8_t> VectorEnv::quarantined() const { return model_->env.quarantined(); }
std::span<const std::uint8_t> VectorEnv::acted() const { return model_->env.acted(); }
std::vector<EpisodeResult> VectorEnv::finished() const {
  std::vector<EpisodeResult> results;
  for (const FinishedEpisode& episode : model_->env.finished()) results.push_back(result_of(episode));
  return results;
}

std::vector<InputFile> VectorEnv::input_files() const { return input_files_of(model_->env.config(), *model_->set, model_->made_after); }

AgentPose VectorEnv::pose(int row) const {
  const Pose pose = model_->env.agent(row).pose;
  return {vec3_of(model_->env.source(row).scene->scene->to_world(pose.position)), pose.heading_rad};
}
Navigation VectorEnv::navigation(int row) const {
  const std::shared_ptr<const EnvScene> scene = model_->env.source(row).scene;
  return navigation_of({scene, scene->scene.get()}, {scene, &scene->navmesh});
}
std::string VectorEnv::scene_name(int row) const { return model_->env.source(row).scene->scene->name(); }
std::uint64_t VectorEnv::episode_index(int row) const { return model_->env.agent(row).episode_index; }

std::string VectorEnv::save_state() const { return model_->env.save_state(); }
void VectorEnv::restore_state(std::string_view state) { model_->env.restore(state); }
std::string VectorEnv::snapshot(int env) const { return model_->env.snapshot(env); }
void VectorEnv::restore(int env, std::string_view snapshot) { model_->env.restore(env, snapshot); }

}  // namespace earshot::api
