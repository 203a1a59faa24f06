// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/measured_options.h"

#include "sim/base/errors.h"

namespace earshot {

void MeasuredOptions::add_to(CLI::App& command, const std::string& default_preset) {
  command
      .add_option("--places", places,
                  "YAML or JSON file with the places of the sound files (default: places.yaml or places.json in the measured folder)")
      ->type_name("FILE");
  acoustics.channels = "mono";
  acoustics.add_settings_to(command, default_preset);
}

MeasuredRoom MeasuredOptions::room() const { return load_measured_room(measured, places); }

AcousticConfig MeasuredOptions::config() const {
  acoustics.refuse_settings({"temporal_reuse", "glide_paths"}, "has no effect on single responses", "leave it out");
  AcousticOptions own = acoustics;
  own.settings.insert(own.settings.begin(), "rir_length_s=auto");
  return own.config();
}

std::shared_ptr<const Scene> MeasuredOptions::scene(const std::string& spec) const {
  return std::make_shared<const Scene>(load_scene(spec, acoustics.scene.overrides()));
}

}  // namespace earshot
