#include "policy/actor_critic.h"

#include <fmt/format.h>

#include "policy/weight_init.h"
#include "sim/base/errors.h"

namespace earshot {

ActorCriticImpl::ActorCriticImpl(const ObservationSpec& spec, const PolicyConfig& config) : spec_(spec), config_(config) {
  if (!spec.depth && !spec.spectrogram && !spec.pointgoal)
    throw InputError("sensors", "all are off: the policy would have nothing to go by", "switch depth, spectrogram or pointgoal on");
  int features = spec.pointgoal ? 2 : 0;
  if (spec.spectrogram) {
    const int rows = spec.sound.rows(), columns = spec.sound.columns();
    audio_ = register_module(
        "audio", ConvEncoder("spectrogram", rows, columns, 2, audio_layers(rows, columns, config.conv_channels), config.audio_features));
    features += config.audio_features;
  }
  if (spec.depth) {
    visual_ = register_module("visual", ConvEncoder("depth picture", spec.camera.height_px, spec.camera.width_px, 1,
                                                    visual_layers(config.conv_channels), config.visual_features));
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
  if (spec_.pointgoal) features.push_back(observations.pointgoal);
  if (spec_.spectrogram) features.push_back(audio_->forward(observations.spectrogram));
  if (spec_.depth) features.push_back(visual_->forward(observations.depth));
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
  if (spec_.depth) line += fmt::format(" depth {}x{}x1 -> {},", spec_.camera.height_px, spec_.camera.width_px, config_.visual_features);
  if (spec_.spectrogram)
    line += fmt::format(" spectrogram {}x{}x2 -> {},", spec_.sound.rows(), spec_.sound.columns(), config_.audio_features);
  if (spec_.pointgoal) line += " pointgoal 2,";
  return line + fmt::format(" conv {}, gru {}, actions {}", config_.conv_channels, config_.hidden_size, kNumActions);
}

}  // namespace earshot
