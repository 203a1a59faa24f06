#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/rir_synthesis.h"

namespace earshot {

/// The options that every command which renders sound shares.
struct AcousticOptions {
  std::string scene, preset, channels = "binaural", hrtf;
  std::vector<std::string> settings;   ///< key=value
  double rate_hz = 0;                  ///< 0: the preset's
  double unit_m = 0, simplify_m = 0;   ///< 0: what the scene says
  std::int64_t seed = -1;              ///< negative: the preset's

  void add_to(CLI::App& command, const std::string& default_preset);
  /// Preset, then what the channels need (harmonics as far as the tracers carry them), then --set, --rate and --seed; validated.
  [[nodiscard]] AcousticConfig config() const;
  [[nodiscard]] ListenerLayout layout() const { return ListenerLayout::named(channels); }
  [[nodiscard]] AcousticScene load(const AcousticConfig& config) const;
  [[nodiscard]] std::shared_ptr<const SynthesisTables> tables(const AcousticScene& scene) const;
};

}  // namespace earshot
