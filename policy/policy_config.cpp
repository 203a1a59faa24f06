// SPDX-License-Identifier: Apache-2.0
#include "policy/policy_config.h"

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, PolicyConfig& config) {
  constexpr int largest = 8192;  // the recurrent weights of a layer twice this size would fill 3 GB
  const Allowed width = Allowed::between(1, largest);
  reader.read("hidden_size", config.hidden_size, width, "Size of the recurrent state (GRU).");
  reader.read("visual_features", config.visual_features, width, "Size of the visual encoder's output.");
  reader.read("audio_features", config.audio_features, width, "Size of the audio encoder's output.");
  reader.read("recurrent", config.recurrent, "Keeps the recurrent state between steps. false: the agent has no memory; for comparison.");
  reader.read("conv_channels", config.conv_channels, width, "Channels of the first convolution; the others have twice as many.");
  reader.read("initial_stop_logit", config.initial_stop_logit,
              Allowed::between(-20, 20).because("beyond that the agent cannot learn to stop, or to move"),
              "Bias of the action stop before training. At -4 the first episodes are walks of about fifty steps.");
  reader.read("seed", config.seed, "Seed of the initial weights; in a run config the default is the seed of the run.");
  reader.read("guided_critic", config.guided_critic,
              "The critic reads goal_state beside the recurrent state, in training only (asymmetric actor-critic).");
  reader.read("goal_heads", config.goal_heads, "Further outputs that learn the place of the goal; together with guidance.goal.");
  reader.read("normalize_values", config.normalize_values,
              "The critic learns returns normalized by their running mean and deviation (PopArt).");
  reader.read(
      "module", config.module, Allowed::text("a TorchScript file"),
      "TorchScript file of a network that replaces the built-in one; the sizes above then have no effect. Empty: the built-in network.");
}

void validate(const PolicyConfig& config) { check_values(config, "policy"); }

}  // namespace earshot
