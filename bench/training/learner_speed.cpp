// SPDX-License-Identifier: Apache-2.0
#include "bench/training/learner_speed.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/stopwatch.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/rollout_collector.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/field_decision.h"

namespace earshot {
namespace {

torch::Tensor drawn_rows(const SensorSpec& sensor, int envs) {
  const std::vector<std::int64_t> sizes = sizes_of(sensor, {envs});
  if (sensor.type == SensorType::float32) return torch::rand(sizes);
  return torch::randint(sensor.type == SensorType::uint8 ? 256 : 4, sizes, scalar_type(sensor.type));
}

RolloutBuffer drawn_rollout(const RunConfig& config, ActorCritic& policy) {
  torch::manual_seed(1);
  const torch::NoGradGuard no_gradient;
  const int envs = config.envs_per_worker;
  const ObservationSpec spec = training_sensors(config);
  RolloutBuffer rollout(spec, config.rollout_steps, envs, config.policy.hidden_size);
  const auto size = static_cast<std::size_t>(envs);
  rollout.begin(torch::zeros({envs, policy->hidden_size()}));
  torch::Tensor not_done = torch::zeros({envs});
  for (int t = 0; t < config.rollout_steps; ++t) {
    ObservationTensors seen;
    for (const SensorSpec& sensor : sensor_table(spec, 1)) seen.add(sensor.name, drawn_rows(sensor, envs));
    rollout.push(seen, not_done, torch::randint(4, {envs}, torch::kInt64), torch::full({envs}, -1.386f), torch::randn({envs}));
    std::vector<float> rewards(size);
    std::vector<std::uint8_t> ended(size), no_truncation(size), valid(size, 1);
    for (std::size_t env = 0; env < size; ++env) {
      ended[env] = (t + 1 + 17 * static_cast<int>(env)) % kSpeedEpisodeSteps == 0;
      rewards[env] = 0.1f * static_cast<float>((t + static_cast<int>(env)) % 7);
      not_done[static_cast<std::int64_t>(env)] = ended[env] != 0 ? 0.f : 1.f;
    }
    rollout.push_outcome(rewards, ended, no_truncation, torch::zeros({envs}), valid);
  }
  rollout.finish(torch::zeros({envs}));
  return rollout;
}

}  // namespace

struct LearnerSpeedTest::State {
  explicit State(const RunConfig& of_run)
      : config(of_run),
        policy(of_run.env.observation, of_run.policy),
        learner(policy, of_run.ppo, of_run.seed, of_run.guidance, 1),
        alone(make_single_worker()),
        rollout(drawn_rollout(of_run, policy)) {}

  RunConfig config;
  ActorCritic policy;
  PpoLearner learner;
  std::unique_ptr<Collective> alone;
  RolloutBuffer rollout;
  std::uint64_t updates = 0;
};

LearnerSpeedTest::LearnerSpeedTest(const RunConfig& config) {
  require(config.policy.module.empty(), "policy.module", config.policy.module,
          "cannot be measured: the counts are those of the built-in network");
  use_one_torch_thread();
  state_ = std::make_unique<State>(config);
}

LearnerSpeedTest::~LearnerSpeedTest() = default;

void LearnerSpeedTest::warm_up() { state_->learner.update(state_->rollout, 0, state_->updates++, *state_->alone); }

LearnerSpeed LearnerSpeedTest::measure(double cpu_s) {
  State& state = *state_;
  LearnerSpeed speed;
  int updates = 0;
  double samples = 0, learn_s = 0;
  const Stopwatch watch;
  do {
    const UpdateStats stats = state.learner.update(state.rollout, 0, state.updates++, *state.alone);
    samples += static_cast<double>(stats.epochs) * state.rollout.num_steps() * state.rollout.num_envs();
    speed.forward_ms += 1e3 * stats.forward_s;
    speed.backward_ms += 1e3 * stats.backward_s;
    speed.step_ms += 1e3 * stats.step_s;
    learn_s += stats.learn_s + stats.reduce_s;
    ++updates;
  } while (watch.cpu_s() < cpu_s);
  speed.samples_per_cpu_s = samples / watch.cpu_s();
  speed.samples_per_s = samples / watch.wall_s();
  for (double* stage : {&speed.forward_ms, &speed.backward_ms, &speed.step_ms}) *stage /= updates;
  speed.other_ms = 1e3 * learn_s / updates - speed.forward_ms - speed.backward_ms - speed.step_ms;

  const torch::NoGradGuard no_gradient;
  const ObservationTensors row = state.rollout.observations.map([](const torch::Tensor& slab) { return slab[0]; });
  const torch::Tensor continues = torch::ones({state.rollout.num_envs()});
  torch::Tensor hidden = state.rollout.hidden;
  hidden = state.policy->step(row, hidden, continues).hidden;
  const Stopwatch acting;
  int steps = 0;
  do {
    hidden = state.policy->step(row, hidden, continues).hidden;
    ++steps;
  } while (acting.cpu_s() < cpu_s / 4);
  speed.actor_rows_per_cpu_s = static_cast<double>(steps) * state.rollout.num_envs() / acting.cpu_s();
  return speed;
}

std::int64_t LearnerSpeedTest::num_parameters() const { return state_->policy->num_parameters(); }

std::string LearnerSpeedTest::torch_request(double cpu_s, bool warm_up) const {
  const RunConfig& config = state_->config;
  const PolicyConfig& policy = config.policy;
  const PpoConfig& ppo = config.ppo;
  std::string pictures;
  std::int64_t inputs = 0;
  const auto layer_text = [](const std::vector<ConvLayer>& layers) {
    std::string text;
    for (const ConvLayer& layer : layers)
      text += fmt::format("{}[{}, {}, {}]", text.empty() ? "" : ", ", layer.kernel, layer.stride, layer.channels);
    return text;
  };
  const auto add = [&](std::int64_t rows, std::int64_t columns, std::int64_t channels, const std::vector<ConvLayer>& layers, int features) {
    pictures += fmt::format("{}{{\"shape\": [{}, {}, {}], \"layers\": [{}], \"features\": {}}}", pictures.empty() ? "" : ", ", rows,
                            columns, channels, layer_text(layers), features);
    inputs += features;
  };
  // Inputs of the policy's encoders, from the shapes of their weights: channels of the first convolution, and the pictures of the
  // sensors.
  std::int64_t sound_rows = 0, sound_columns = 0, sound_channels = 0;
  std::vector<std::array<std::int64_t, 3>> cameras;
  for (const SensorSpec& sensor : sensor_table(config.env.observation, 1)) {
    if (sensor.kind == SensorKind::spectrogram || sensor.kind == SensorKind::interaural) {
      sound_rows = sensor.shape[0], sound_columns = sensor.shape[1], sound_channels += sensor.shape[2];
    } else if (sensor.camera >= 0) {
      const auto index = static_cast<std::size_t>(sensor.camera);
      cameras.resize(std::max(cameras.size(), index + 1));
      cameras[index] = {sensor.shape[0], sensor.shape[1], cameras[index][2] + sensor.shape[2]};
    }
  }
  if (sound_channels > 0)
    add(sound_rows, sound_columns, sound_channels,
        audio_layers(static_cast<int>(sound_rows), static_cast<int>(sound_columns), policy.conv_channels), policy.audio_features);
  for (const auto& [rows, columns, channels] : cameras)
    if (channels > 0) add(rows, columns, channels, visual_layers(policy.conv_channels), policy.visual_features);
  const auto parameters = state_->policy->named_parameters();
  const std::int64_t read = parameters["rnn.weight_ih"].size(1);
  const torch::Tensor* guided = parameters.find("critic_hidden.weight");
  return fmt::format(
      "{{\"steps\": {}, \"envs\": {}, \"episode_steps\": {}, \"hidden\": {}, \"vector\": {}, \"actions\": {}, \"guide\": {}, "
      "\"guided_width\": {}, \"goal\": {}, \"imitation\": {}, \"pictures\": [{}], \"seconds\": {}, \"warm_up\": {},\n"
      "\"ppo\": {{\"epochs\": {}, \"minibatches\": {}, \"clip\": {}, \"clip_value_loss\": {}, \"value_coefficient\": {}, "
      "\"entropy_coefficient\": {}, \"learning_rate\": {}, \"adam_epsilon\": {}, \"max_gradient_norm\": {}}}}}\n",
      state_->rollout.num_steps(), state_->rollout.num_envs(), kSpeedEpisodeSteps, policy.hidden_size, read - inputs, kNumActions,
      guided != nullptr ? guided->size(1) - policy.hidden_size : 0, guided != nullptr ? guided->size(0) : 0,
      policy.goal_heads ? kGoalOutputs : 0, config.guidance.imitation > 0, pictures, cpu_s, warm_up, ppo.epochs, ppo.minibatches, ppo.clip,
      ppo.clip_value_loss, ppo.value_coefficient, ppo.entropy_coefficient, ppo.learning_rate, ppo.adam_epsilon, ppo.max_gradient_norm);
}

TrainingSpeed measure_training(const RunConfig& asked, double wall_s, const std::string& folder) {
  use_one_torch_thread();
  RunConfig config = asked;
  config.out = folder;
  config.train.file = (std::filesystem::path(folder) / "train.json.gz").string();
  if (config.train.scenes.empty()) throw InputError("data.train.scenes", "is empty", "name at least one SCENE, for example house:1");
  config.train.scenes = {expand_range(config.train.scenes.front()).front()};
  config.train.goals_per_scene = 2;
  config.train.episodes_per_scene = 4 * config.envs_per_worker;
  config.env.scene_store.clear();
  config.env.field_store = (std::filesystem::path(folder) / "fields").string();
  config.env.quarantine_dir = (std::filesystem::path(folder) / "quarantine").string();
  config.env.order = EpisodeOrder::random;
  const auto set = std::make_shared<const EpisodeSet>(generate_data(config.train, config.env));
  config = decide_field(config).config;

  EnvConfig env_config = config.env;
  env_config.observation = training_sensors(config);
  BatchedEnv env(env_config, set, make_scene_cache(config.env), config.envs_per_worker);
  const PolicyNetwork policy = make_policy(config.env.observation, config.policy);
  PpoLearner learner(policy, config.ppo, config.seed, config.guidance, static_cast<double>(config.env.task.success_radius_m));
  RolloutCollector collector(rollout_config(config), env, policy, 0);
  const auto alone = make_single_worker();
  env.reset();

  TrainingSpeed speed;
  EpisodeSums finished;
  std::uint64_t update = 0;
  const auto round = [&] {
    collector.collect(0, finished, speed.stages);
    const UpdateStats stats = learner.update(collector.rollout(), 0, update++, *alone);
    speed.stages.learn += stats.learn_s;
    speed.stages.reduce += stats.reduce_s;
  };
  round();  // builds what the scene and its goals need
  speed.stages = {};
  const Stopwatch watch;
  do {
    round();
    speed.steps += static_cast<std::uint64_t>(config.rollout_steps) * static_cast<std::uint64_t>(config.envs_per_worker);
  } while (watch.wall_s() < wall_s);
  speed.wall_s = watch.wall_s();
  return speed;
}

}  // namespace earshot
