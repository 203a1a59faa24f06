#include "envs/config/data_config.h"

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, DataConfig& data) {
  reader.read("file", data.file);
  reader.read("scenes", data.scenes);
  reader.read("sounds", data.sounds);
  reader.read("episodes_per_scene", data.episodes_per_scene);
  reader.read("goals_per_scene", data.goals_per_scene);
  reader.read("seed", data.seed);
  const auto section = [&](const char* key, auto& config) {
    ConfigReader child = reader.child(key);
    read(child, config);
    child.finish();
    validate(config);
  };
  section("filter", data.filter);
  section("scenario", data.scenario);
  section("agents", data.agents);
  require(data.episodes_per_scene > 0, reader.prefix() + "episodes_per_scene", data.episodes_per_scene, "must be positive");
  require(data.goals_per_scene >= 0 && data.goals_per_scene <= 100'000, reader.prefix() + "goals_per_scene", data.goals_per_scene,
          "must be in [0, 100000]; 0: each episode has its own goal");
}

}  // namespace earshot
