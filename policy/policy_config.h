// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace earshot {

class ConfigReader;

/// Of a file PolicyConfig::module.
inline constexpr std::size_t kMaxModuleBytes = std::size_t{1} << 30;

/// Sizes of the network; the defaults are docs/reference/formats.md, section 6.5 (4,952,453 parameters with 128 x 128 depth and 65 x 26 x 2
/// spectrograms).
struct PolicyConfig {
  int hidden_size = 512;  ///< of the GRU
  int visual_features = 512, audio_features = 512;
  /// false: the state before each step is zero, so that the agent uses the current observation alone; for comparison.
  bool recurrent = true;
  int conv_channels = 32;  ///< first layer; the others have twice as many
  /// Bias of `stop` before training; 0 in the original.  At 0 a new agent stops once in four steps and long never learns what walking is
  /// worth; at -4 its first episodes are walks of some fifty steps.
  double initial_stop_logit = 0;
  std::uint64_t seed = 0;  ///< of the initial weights
  /// The critic reads goal_state beside the recurrent state (Pinto et al. 2018, asymmetric actor-critic).  It is not there in evaluation,
  /// where values are 0 and not needed.
  bool guided_critic = false;
  bool goal_heads = false;  ///< further outputs that learn to say where the goal is (PolicyOutput::goal)
  /// The critic learns returns in units of their running mean and deviation (PopArt, van Hasselt et al. 2016).
  bool normalize_values = false;
  /// TorchScript file of a network in place of the built-in one (module_policy.h), which then has no use for the sizes above; empty: the
  /// built-in one.
  std::string module = {};
};
void read(ConfigReader& reader, PolicyConfig& config);
/// Throws InputError naming the key, its value and the rule.
void validate(const PolicyConfig& config);

}  // namespace earshot
