// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/gtc/quaternion.hpp>
#include <optional>
#include <string>
#include <vector>

#include "compat/rlr_audio_propagation.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/audio/head/listener_layout.h"

namespace earshot::compat {

/// What the environment of the process says (rlr_audio_propagation.h).
struct EnvironmentSettings {
  std::uint64_t seed = 0;
  std::optional<std::string> preset;  ///< of quality; none: the caller's configuration decides
};
/// Of EARSHOT_SEED and EARSHOT_PRESET; empty ones count as not set.  Throws CallError for another value than these take.
EnvironmentSettings read_environment();

/// A configuration of the C interface in terms of the engine (docs/reference/rlr_library.md).
struct ContextSettings {
  std::string preset = "balanced";
  AcousticConfig acoustics;  ///< sh_order: of ears; rir_length_s: 0
  float longest_rir_s = 4;
  double unit_m = 1;
  float gain = 1;
  std::optional<glm::dquat> hrtf_to_listener;  ///< of the axes of head filters; none: the listener's own
  std::optional<float> simplify_m;
  bool has_temporal_coherence = false;
  std::vector<std::string> warnings;  ///< of settings that were limited, one line each
};

/// Throws CallError for a configuration that breaks a rule of the interface.
ContextSettings read_configuration(const RLRA_ContextConfiguration& configuration, const EnvironmentSettings& environment);
RLRA_ContextConfiguration default_configuration();

/// Arguments of `earshot rir` that give this config and gain.
std::string rir_arguments(const ContextSettings& settings, const AcousticConfig& config);

}  // namespace earshot::compat
