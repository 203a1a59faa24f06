// SPDX-License-Identifier: Apache-2.0
#include "envs/config/data_config.h"

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, DataConfig& data) {
  reader.read("file", data.file, Allowed::text("an episode set"),
              "Episode set (JSON or JSON.gz), relative to the working folder; made from the other keys where it is missing.");
  reader.read("scenes", data.scenes, Allowed::text("a SCENE"),
              "Scenes of the episodes. A range stands for several: house:10..14,rooms=3 for five.");
  reader.read("sounds", data.sounds, Allowed::text("a sound"),
              "Sounds, drawn per episode: files, folders of files, or synth:KIND:SEED. synth:bird:0..3 stands for four.");
  reader.read("episodes_per_scene", data.episodes_per_scene, Allowed::at_least(1), "Episodes generated in each scene.");
  reader.read("goals_per_scene", data.goals_per_scene, Allowed::between(0, 100'000),
              "Goals that the episodes of a scene share, far from each other. 0: each episode has its own goal.");
  reader.read("seed", data.seed, "Seed of the generated episodes.");
  const auto section = [&](const char* key, auto& config, About about) {
    ConfigReader child = reader.child(key, about);
    read(child, config);
    child.finish();
    validate(config);
  };
  section("filter", data.filter, "Generated episodes that are kept.");
  section("scenario", data.scenario, "Onset, duration, distractors and noise of generated episodes.");
  section("agents", data.agents, "Agents of generated episodes.");
}

}  // namespace earshot
