#include "apps/acoustic_options.h"

#include "sim/base/errors.h"

namespace earshot {

void AcousticOptions::add_to(CLI::App& command, const std::string& default_preset) {
  preset = default_preset;
  command.add_option("SCENE", scene, "Mesh file, shoebox:XxYxZ[@M], house:SEED, or scene YAML")->required();
  command.add_option("--preset", preset, "Quality: fast (training), balanced, high (reference)")->capture_default_str();
  command.add_option("--set", settings,
                     "key=value over the preset.  Switches (auto|on|off): direct early late air_absorption diffraction transmission.  Numbers: rays rir_length_s "
                     "bands threads scattering early_order early_candidate_rays max_bounces time_bin_s sh_order source_radius_m diffuse_last_leg");
  command.add_option("--channels", channels, "mono or binaural")->capture_default_str();
  command.add_option("--hrtf", hrtf, "SOFA file of head filters (default: a rigid sphere of 8.75 cm)");
  command.add_option("--rate", rate_hz, "Sample rate in Hz, 8000 to 96000 (default: the preset's)");
  command.add_option("--seed", seed, "Seed of rays and carriers; the same seed gives the same bits");
}

AcousticConfig AcousticOptions::config() const {
  AcousticConfig config = acoustic_preset(preset);
  ConfigReader reader = ConfigReader::from_text("", "--set", settings);
  read(reader, config);
  reader.finish();
  if (rate_hz != 0) config.sample_rate_hz = static_cast<float>(rate_hz);
  if (seed >= 0) config.seed = static_cast<std::uint64_t>(seed);
  validate(config);
  return config;
}

ChannelLayout AcousticOptions::layout() const {
  if (channels == "mono") return ChannelLayout::mono;
  if (channels == "binaural") return ChannelLayout::binaural;
  throw InputError("--channels " + channels, "is not available", "choose mono or binaural");
}

AcousticScene AcousticOptions::load(const AcousticConfig& config) const {
  return {std::make_shared<const Scene>(load_scene(scene)), config};
}

std::shared_ptr<const SynthesisTables> AcousticOptions::tables(const AcousticScene& acoustics) const {
  const AcousticConfig& config = acoustics.config();
  std::shared_ptr<const Hrtf> head;
  if (layout() == ChannelLayout::binaural) head = hrtf.empty() ? Hrtf::rigid_sphere(config.sample_rate_hz) : Hrtf::from_sofa(hrtf, config.sample_rate_hz);
  return make_synthesis_tables(config, acoustics.bands(), layout(), head);
}

}  // namespace earshot
