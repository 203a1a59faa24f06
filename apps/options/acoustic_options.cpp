// SPDX-License-Identifier: Apache-2.0
#include "apps/options/acoustic_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/acoustics/synthesis/channel_order.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

/// The keys of --set, as their reader declares them.
std::string settings_help() {
  std::vector<std::string> switches, others;
  for (const ConfigKey& key : keys_of<AcousticConfig>()) (key.type == KeyType::choice ? switches : others).push_back(key.name);
  return "Override a key of the preset: key=value; may be repeated. 'earshot config KEY' explains a key. Switches (auto|on|off): " +
         listed(switches, " ") + ". Values: " + listed(others, " ");
}

}  // namespace

void AcousticOptions::add_to(CLI::App& command, const std::string& default_preset) {
  scene.add_to(command);
  add_settings_to(command, default_preset);
  command
      .add_option("--channels", channels,
                  "Listener: " + std::string(kListenerLayouts) +
                      " (YAML or JSON list of microphones). docs/reference/channels.md has their order and angles")
      ->capture_default_str();
  command.add_option("--hrtf", hrtf, "SOFA file with HRTFs (default: a rigid sphere of radius 8.75 cm)");
  command
      .add_option("--hrtf-orientation", hrtf_orientation_deg,
                  "HEADING,PITCH,ROLL in degrees: orientation of the HRTFs relative to the listener (default: 0,0,0)")
      ->delimiter(',')
      ->expected(3);
  scene.add_simplify_to(command);
}

void AcousticOptions::add_settings_to(CLI::App& command, const std::string& default_preset) {
  preset = default_preset;
  command.add_option("--preset", preset, "Quality preset: fast (training), balanced or high (reference)")->capture_default_str();
  command.add_option("--set", settings, settings_help());
  command.add_option("--rate", rate_hz, "Sample rate in Hz, 8000 to 96000 (default: the preset's)");
  command.add_option("--seed", seed, "Random seed; the same seed gives the same bits");
}

void AcousticOptions::add_accuracy_to(CLI::App& command) {
  command.add_option(
      "--accuracy", accuracy,
      "Largest error of a response, for example t20=5%,drr=1dB,edc=1dB or a part of this (RMS over octaves and positions against converged "
      "paths). A planner calibrates in the scene and picks the cheapest number of rays, method, reflection order and diffraction that meet "
      "it. The length of the response is set automatically; everything else comes from the preset");
}

void AcousticOptions::refuse_settings(const std::vector<std::string>& keys, const std::string& problem, const std::string& remedy) const {
  for (const std::string& setting : settings)
    for (const std::string& key : keys)
      if (setting.substr(0, setting.find('=')) == key) throw InputError("--set " + setting, problem, remedy);
}

std::optional<AccuracyTarget> AcousticOptions::accuracy_target() const {
  if (!accuracy) return std::nullopt;
  const auto keys = keys_of_accuracy();
  refuse_settings({keys.begin(), keys.end()}, "sets a key that --accuracy chooses", "give either --accuracy or this key");
  return AccuracyTarget::parse(*accuracy);
}

AcousticConfig AcousticOptions::config() const {
  AcousticConfig config = acoustic_preset(preset);
  config.sh_order = std::max(harmonics_of(layout(), config), least_order);
  if (accuracy) config.rir_length_s = 0;
  ConfigReader reader = ConfigReader::from_text("", "--set", settings);
  read(reader, config);
  reader.finish();
  if (rate_hz) config.sample_rate_hz = static_cast<float>(*rate_hz);
  if (seed) config.seed = *seed;
  validate(config);
  return config;
}

ListenerOrientation AcousticOptions::orientation(double heading_deg, double pitch_deg, double roll_deg) const {
  constexpr double degree = std::numbers::pi / 180;
  require(std::isfinite(heading_deg), "--heading", heading_deg, "must be finite");
  require(std::isfinite(pitch_deg), "--pitch", pitch_deg, "must be finite");
  require(std::isfinite(roll_deg), "--roll", roll_deg, "must be finite");
  const ListenerOrientation listener = pitch_deg == 0 && roll_deg == 0
                                           ? ListenerOrientation(heading_deg * degree)
                                           : ListenerOrientation(heading_deg * degree, pitch_deg * degree, roll_deg * degree);
  if (hrtf_orientation_deg.empty() || layout().kind != ListenerKind::binaural) return listener;
  for (const double value : hrtf_orientation_deg) require(std::isfinite(value), "--hrtf-orientation", value, "must be finite");
  const ListenerOrientation filters(hrtf_orientation_deg[0] * degree, hrtf_orientation_deg[1] * degree, hrtf_orientation_deg[2] * degree);
  return ListenerOrientation(listener.local_to_world() * filters.local_to_world());
}

AcousticScene AcousticOptions::load(const AcousticConfig& config) const {
  return {std::make_shared<const Scene>(load_scene(scene.scene, scene.overrides())), config};
}

std::shared_ptr<const SynthesisTables> AcousticOptions::tables(const AcousticScene& acoustics) const {
  const AcousticConfig& config = acoustics.config();
  const ListenerLayout listener = layout();
  std::shared_ptr<const Hrtf> head;
  if (listener.kind == ListenerKind::binaural)
    head = hrtf.empty() ? Hrtf::rigid_sphere(config.sample_rate_hz) : Hrtf::from_sofa(hrtf, config.sample_rate_hz);
  return make_synthesis_tables(config, acoustics.bands(), listener, head);
}

std::shared_ptr<const SynthesisTables> AcousticOptions::omni_tables(const AcousticScene& acoustics) {
  return make_synthesis_tables(acoustics.config(), acoustics.bands(), ListenerLayout(ChannelLayout::mono), nullptr);
}

}  // namespace earshot
