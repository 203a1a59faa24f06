// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/options/scene_options.h"
#include "sim/acoustics/accuracy/accuracy_target.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// Options common to all commands that render sound.
struct AcousticOptions {
  SceneOptions scene;
  std::string preset, channels = "binaural", hrtf;
  std::vector<std::string> settings;  ///< key=value
  std::optional<double> rate_hz;      ///< default: the preset's
  std::optional<std::uint64_t> seed;  ///< default: the preset's

  std::vector<double> hrtf_orientation_deg;  ///< heading, pitch, roll of the head filters in the listener's axes; empty: none

  int least_order = 0;  ///< of harmonics, before --set

  std::optional<std::string> accuracy;  ///< as AccuracyTarget::parse reads it; none: the preset decides

  void add_to(CLI::App& command, const std::string& default_preset);
  /// --preset, --set, --rate and --seed alone.
  void add_settings_to(CLI::App& command, const std::string& default_preset);
  /// --accuracy, for commands that plan with it.
  void add_accuracy_to(CLI::App& command);
  /// Throws InputError for a --set of one of these keys: a setting that changes nothing is an error.
  void refuse_settings(const std::vector<std::string>& keys, const std::string& problem, const std::string& remedy) const;
  /// What --accuracy asks for, if anything.  Throws InputError for a setting of what it chooses.
  [[nodiscard]] std::optional<AccuracyTarget> accuracy_target() const;
  /// Preset, then what the channels need (harmonics as far as the tracers carry them; none for a microphone alike on all sides), then
  /// --set, --rate and --seed; validated.
  [[nodiscard]] AcousticConfig config() const;
  [[nodiscard]] ListenerLayout layout() const { return ListenerLayout::named(channels); }
  /// Orientation of the channels for a listener of these angles; for ears the orientation of their filters on top.  Throws InputError if
  /// not finite.
  [[nodiscard]] ListenerOrientation orientation(double heading_deg, double pitch_deg, double roll_deg) const;
  [[nodiscard]] AcousticScene load(const AcousticConfig& config) const;
  [[nodiscard]] std::shared_ptr<const SynthesisTables> tables(const AcousticScene& scene) const;
  /// Of an omnidirectional microphone in the place of the listener.
  [[nodiscard]] static std::shared_ptr<const SynthesisTables> omni_tables(const AcousticScene& scene);
};

}  // namespace earshot
