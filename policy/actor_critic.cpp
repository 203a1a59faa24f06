#include "policy/actor_critic.h"

#include <fmt/format.h>

#include <algorithm>

#include "policy/weight_init.h"
#include "sim/base/errors.h"

namespace earshot {

namespace {

/// Encoders have parameters of their own; the other sensors are features as they are.
bool is_picture(const SensorSpec& sensor) { return sensor.camera >= 0 || sensor.kind == SensorKind::topdown_map; }
bool is_vector(const SensorSpec& sensor) { return !is_picture(sensor) && sensor.kind != SensorKind::spectrogram; }

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

/// What the recurrent layer reads of a sensor without an encoder.
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
    case SensorKind::pose: {  // metres and metres, the angle, what follows it
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
    : sensors_(sensor_table(spec, 1)), config_(config) {
  if (sensors_.empty())
    throw InputError("sensors", "all are off: the policy would have nothing to go by", "switch depth, spectrogram or pointgoal on");
  int features = 0;
  for (const SensorSpec& sensor : sensors_) {
    if (sensor.kind == SensorKind::waveform || sensor.kind == SensorKind::heard || sensor.kind == SensorKind::semantic)
      throw InputError("observation." + sensor.name, "has no encoder in the policy",
                       "switch it off for training; a policy hears by the spectrogram and sees by depth, rgb and normals");
    if (is_vector(sensor)) features += num_features(sensor);
    if (sensor.kind != SensorKind::spectrogram) continue;
    const int rows = sensor.shape[0], columns = sensor.shape[1];
    audio_ = register_module(
        "audio", ConvEncoder("spectrogram", rows, columns, 2, audio_layers(rows, columns, config.conv_channels), config.audio_features));
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
  critic_ = register_module("critic", torch::nn::Linear(config.hidden_size, 1));
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
  std::vector<torch::Tensor> features;
  std::vector<std::vector<torch::Tensor>> channels(visual_.size());
  for (const SensorSpec& sensor : sensors_) {
    const torch::Tensor& rows = observations[sensor.name];
    if (is_vector(sensor)) features.push_back(features_of(sensor, rows));
    if (is_picture(sensor))
      channels[picture_index(sensors_, sensor)].push_back(sensor.type == SensorType::uint8 ? rows.to(torch::kFloat32).div_(255) : rows);
  }
  if (audio_) features.push_back(audio_->forward(observations["spectrogram"]));
  for (std::size_t camera = 0; camera < visual_.size(); ++camera)
    features.push_back(visual_[camera]->forward(channels[camera].size() == 1 ? channels[camera][0] : torch::cat(channels[camera], 3)));
  return features.size() == 1 ? features[0] : torch::cat(features, 1);
}

PolicyOutput ActorCriticImpl::step(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) {
  return sequence(observations, hidden, not_done.unsqueeze(0));
}

PolicyOutput ActorCriticImpl::sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) {
  const std::int64_t T = not_done.size(0), B = not_done.size(1);
  const torch::Tensor features = encode(observations);  // [T * B, features]
  EARSHOT_EXPECT(features.size(0) == T * B && hidden.size(0) == B && hidden.size(1) == config_.hidden_size);
  const torch::Tensor states = rnn_->forward(features.view({T, B, -1}), hidden, not_done);  // [T, B, hidden_size]
  const torch::Tensor flat = states.view({T * B, config_.hidden_size});
  return {.logits = actor_->forward(flat), .value = critic_->forward(flat).squeeze(1), .hidden = states[T - 1]};
}

std::int64_t ActorCriticImpl::num_parameters() const {
  std::int64_t count = 0;
  for (const torch::Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

std::string ActorCriticImpl::architecture() const {
  std::string line = "actor-critic v1:";
  for (const SensorSpec& sensor : sensors_) {
    line += fmt::format(" {} {}", sensor.name, fmt::join(sensor.shape, "x"));
    if (is_picture(sensor)) line += fmt::format(" -> {}", config_.visual_features);
    if (sensor.kind == SensorKind::spectrogram) line += fmt::format(" -> {}", config_.audio_features);
    line += ",";
  }
  return line + fmt::format(" conv {}, gru {}, actions {}", config_.conv_channels, config_.hidden_size, kNumActions);
}

}  // namespace earshot
