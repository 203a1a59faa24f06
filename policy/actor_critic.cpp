// SPDX-License-Identifier: Apache-2.0
#include "policy/actor_critic.h"

#include <fmt/format.h>

#include <algorithm>

#include "policy/weight_init.h"
#include "sim/base/errors.h"
#include "sim/base/text/listed.h"

namespace earshot {

namespace {

bool is_sound(const SensorSpec& sensor) { return sensor.kind == SensorKind::spectrogram || sensor.kind == SensorKind::interaural; }

/// Encoders have parameters of their own; the other sensors are features as they are.
bool is_picture(const SensorSpec& sensor) { return sensor.camera >= 0 || sensor.kind == SensorKind::topdown_map; }
bool is_vector(const SensorSpec& sensor) { return !is_picture(sensor) && !is_sound(sensor); }

/// Inputs of a guided critic from goal_state: both distances, straight and on a scale that resolves near ones, both bearings.
constexpr int kGuideFeatures = 7, kGuidedWidth = 64;

torch::Tensor guide_features(const torch::Tensor& goal_state) {
  const torch::Tensor metres = goal_state.slice(1, 0, 1), line = goal_state.slice(1, 1, 2), bearings = goal_state.slice(1, 2, 4);
  return torch::cat({0.1 * metres, metres.log1p(), 0.1 * line, bearings.cos(), bearings.sin()}, 1);
}

/// Which picture of the policy a sensor is part of: cameras have one each, the map has the one after them.
std::size_t picture_index(const std::vector<SensorSpec>& sensors, const SensorSpec& sensor) {
  int cameras = 0;
  for (const SensorSpec& other : sensors) cameras = std::max(cameras, other.camera + 1);
  return static_cast<std::size_t>(sensor.camera >= 0 ? sensor.camera : cameras);
}

/// A camera's pictures, in one of as many channels; or the map.
struct Picture {
  int height = 0, width = 0, channels = 0;
};

std::vector<Picture> pictures_of(const std::vector<SensorSpec>& sensors) {
  std::vector<Picture> pictures;
  for (const SensorSpec& sensor : sensors) {
    if (!is_picture(sensor)) continue;
    const std::size_t index = picture_index(sensors, sensor);
    pictures.resize(std::max(pictures.size(), index + 1));
    Picture& picture = pictures[index];
    picture = {.height = sensor.shape[0], .width = sensor.shape[1], .channels = picture.channels + sensor.shape[2]};
  }
  return pictures;
}

/// Input of the recurrent layer from a sensor without an encoder.
int num_features(const SensorSpec& sensor) {
  switch (sensor.kind) {
    case SensorKind::gps_compass:
    case SensorKind::pose:
      return static_cast<int>(sensor.count()) + 1;  // an angle is its cosine and sine
    case SensorKind::previous_action:
      return kNumActions + 1;
    default:
      return static_cast<int>(sensor.count());
  }
}

torch::Tensor features_of(const SensorSpec& sensor, const torch::Tensor& rows) {
  switch (sensor.kind) {
    case SensorKind::gps_compass:
    case SensorKind::pose: {  // two distances in metres, the angle, the rest
      const torch::Tensor angle = rows.slice(1, 2, 3);
      return torch::cat({rows.slice(1, 0, 2), angle.cos(), angle.sin(), rows.slice(1, 3)}, 1);
    }
    case SensorKind::previous_action:
      return torch::one_hot(rows.to(torch::kInt64).squeeze(1) + 1, kNumActions + 1).to(torch::kFloat32);
    default:
      return rows.to(torch::kFloat32);
  }
}

}  // namespace

ActorCriticImpl::ActorCriticImpl(const ObservationSpec& spec, const PolicyConfig& config)
    : PolicyNetworkImpl(config), sensors_(sensor_table(spec, 1)) {
  std::erase_if(sensors_, [](const SensorSpec& sensor) { return is_for_learner(sensor.kind); });
  if (sensors_.empty()) throw InputError("sensors", "are all off, so the policy has no input", "switch on depth, spectrogram or pointgoal");
  int features = 0;
  for (const SensorSpec& sensor : sensors_) {
    if (sensor.kind == SensorKind::waveform || sensor.kind == SensorKind::heard || sensor.kind == SensorKind::semantic)
      throw InputError("observation." + sensor.name, "has no encoder in this policy",
                       "switch it off; this policy uses spectrogram and interaural, depth, rgb and normals");
    if (is_vector(sensor)) features += num_features(sensor);
  }
  Picture sound;
  for (const SensorSpec& sensor : sensors_)
    if (is_sound(sensor)) sound = {.height = sensor.shape[0], .width = sensor.shape[1], .channels = sound.channels + sensor.shape[2]};
  if (sound.channels > 0) {
    audio_ = register_module("audio", ConvEncoder("spectrogram", sound.height, sound.width, sound.channels,
                                                  audio_layers(sound.height, sound.width, config.conv_channels), config.audio_features));
    features += config.audio_features;
  }
  for (const Picture& picture : pictures_of(sensors_)) {
    const std::string name = visual_.empty() ? "visual" : fmt::format("visual_{}", visual_.size());
    visual_.push_back(register_module(name, ConvEncoder("camera's picture", picture.height, picture.width, picture.channels,
                                                        visual_layers(config.conv_channels), config.visual_features)));
    features += config.visual_features;
  }
  rnn_ = register_module("rnn", MaskedGru(features, config.hidden_size));
  actor_ = register_module("actor", torch::nn::Linear(config.hidden_size, kNumActions));
  if (config.guided_critic)
    critic_hidden_ = register_module("critic_hidden", torch::nn::Linear(config.hidden_size + kGuideFeatures, kGuidedWidth));
  critic_ = register_module("critic", torch::nn::Linear(config.guided_critic ? kGuidedWidth : config.hidden_size, 1));
  if (config.goal_heads) goal_ = register_module("goal", torch::nn::Linear(config.hidden_size, kGoalOutputs));
  register_value_scale();
  initialize_weights();
  const torch::NoGradGuard no_gradient;
  actor_->bias[static_cast<std::int64_t>(Action::stop)] = config.initial_stop_logit;
}

void ActorCriticImpl::initialize_weights() {
  const torch::NoGradGuard no_gradient;
  std::uint32_t index = 0;  // of the tensor, and of its random stream
  for (const auto& named : named_parameters()) {
    torch::Tensor weight = named.value();
    if (weight.dim() == 1) {
      weight.zero_();
    } else if (named.key().starts_with("rnn.")) {
      // One orthogonal matrix per gate: an orthogonal 3 H x H matrix as a whole would shrink each gate's part by sqrt(3).
      for (const torch::Tensor& gate : weight.chunk(3)) fill_orthogonal(gate, 1.0, config_.seed, index++);
    } else if (named.key().starts_with("actor.")) {
      fill_orthogonal(weight, 0.01, config_.seed, index++);
    } else if (named.key().starts_with("critic.")) {
      fill_orthogonal(weight, 1.0, config_.seed, index++);
    } else {
      fill_kaiming_normal(weight, config_.seed, index++);
    }
  }
}

torch::Tensor ActorCriticImpl::encode(const ObservationTensors& observations) {
  std::vector<torch::Tensor> features, sound;
  std::vector<std::vector<torch::Tensor>> channels(visual_.size());
  for (const SensorSpec& sensor : sensors_) {
    const torch::Tensor& rows = observations[sensor.name];
    if (is_vector(sensor)) features.push_back(features_of(sensor, rows));
    if (is_sound(sensor)) sound.push_back(rows);
    if (is_picture(sensor))
      channels[picture_index(sensors_, sensor)].push_back(sensor.type == SensorType::uint8 ? rows.to(torch::kFloat32).div_(255) : rows);
  }
  if (audio_) features.push_back(audio_->forward(sound.size() == 1 ? sound[0] : torch::cat(sound, 3)));
  for (std::size_t camera = 0; camera < visual_.size(); ++camera)
    features.push_back(visual_[camera]->forward(channels[camera].size() == 1 ? channels[camera][0] : torch::cat(channels[camera], 3)));
  return features.size() == 1 ? features[0] : torch::cat(features, 1);
}

PolicyOutput ActorCriticImpl::sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) {
  const std::int64_t T = not_done.size(0), B = not_done.size(1);
  const torch::Tensor features = encode(observations);  // [T * B, features]
  EARSHOT_EXPECT(features.size(0) == T * B && hidden.size(0) == B && hidden.size(1) == config_.hidden_size);
  const torch::Tensor remembers = config_.recurrent ? not_done : torch::zeros_like(not_done);
  const torch::Tensor states = rnn_->forward(features.view({T, B, -1}), hidden, remembers);  // [T, B, hidden_size]
  const torch::Tensor flat = states.view({T * B, config_.hidden_size});
  return {.logits = actor_->forward(flat),
          .value = values_of(flat, observations["goal_state"]),
          .hidden = states[T - 1],
          .goal = goal_ ? goal_->forward(flat) : torch::Tensor()};
}

/// goal_state: undefined where nothing guides the critic.
torch::Tensor ActorCriticImpl::values_of(const torch::Tensor& states, const torch::Tensor& goal_state) {
  torch::Tensor value;
  if (!config_.guided_critic)
    value = critic_->forward(states);
  else if (goal_state.defined())
    value = critic_->forward(critic_hidden_->forward(torch::cat({states, guide_features(goal_state)}, 1)).relu_());
  else
    return torch::zeros({states.size(0)});
  return scaled_value(value.squeeze(1));
}

void ActorCriticImpl::set_value_scale(double mean, double deviation) { move_value_scale(mean, deviation, critic_->weight, critic_->bias); }

std::string ActorCriticImpl::architecture() const {
  std::string line = "actor-critic v1:";
  for (const SensorSpec& sensor : sensors_) {
    line += fmt::format(" {} {}", sensor.name, listed(sensor.shape, "x"));
    if (is_picture(sensor)) line += fmt::format(" -> {}", config_.visual_features);
    if (is_sound(sensor)) line += fmt::format(" -> {}", config_.audio_features);
    line += ",";
  }
  line += fmt::format(" conv {}, gru {}, actions {}", config_.conv_channels, config_.hidden_size, kNumActions);
  if (!config_.recurrent) line += " without memory";
  if (config_.guided_critic) line += ", guided critic";
  if (config_.goal_heads) line += ", goal heads";
  if (config_.normalize_values) line += ", normalized values";
  return line;
}

}  // namespace earshot
