#include "policy/policy_config.h"

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, PolicyConfig& config) {
  reader.read("hidden_size", config.hidden_size);
  reader.read("visual_features", config.visual_features);
  reader.read("audio_features", config.audio_features);
  reader.read("recurrent", config.recurrent);
  reader.read("conv_channels", config.conv_channels);
  reader.read("initial_stop_logit", config.initial_stop_logit);
  reader.read("seed", config.seed);
  reader.read("guided_critic", config.guided_critic);
  reader.read("goal_heads", config.goal_heads);
  reader.read("normalize_values", config.normalize_values);
}

void validate(const PolicyConfig& config) {
  require(config.initial_stop_logit >= -20 && config.initial_stop_logit <= 20, "policy.initial_stop_logit", config.initial_stop_logit,
          "must be in [-20, 20]: beyond that the agent cannot learn to stop, or to move");
  constexpr int largest = 8192;  // the recurrent weights of a layer twice this size would fill 3 GB
  const auto check = [](const char* key, int value) {
    require(value > 0 && value <= largest, key, value, "must be in [1, 8192]: it is the width of a layer");
  };
  check("policy.hidden_size", config.hidden_size);
  check("policy.visual_features", config.visual_features);
  check("policy.audio_features", config.audio_features);
  check("policy.conv_channels", config.conv_channels);
}

}  // namespace earshot
