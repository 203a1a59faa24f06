// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/episode_data.h"

#include <fmt/format.h>

#include <algorithm>

#include "envs/config/env_config.h"
#include "envs/config/episode_maker.h"
#include "envs/episodes/name_ranges.h"
#include "sim/base/process/progress.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

/// Raised where the same keys come to give other episodes.
constexpr const char* kGeneratorVersion = "1";

}  // namespace

EpisodeSet generate_data(const DataConfig& data, const EnvConfig& env) {
  if (data.scenes.empty()) throw InputError("data.scenes", "is empty", "give at least one scene, for example house:1");
  Progress progress("episodes", "scene", expand_ranges(data.scenes).size());
  EpisodeSet set = make_episodes(data, env.task, make_scene_cache(env), [&](std::size_t done) { progress.update(done); });
  set.generator = generator_keys(data, env);
  save_episode_set(set, data.file);
  return load_episode_set(data.file);
}

std::map<std::string, std::string> generator_keys(const DataConfig& data, const EnvConfig& env) {
  RunConfig run;
  run.env = env;
  run.train = data;
  std::map<std::string, std::string> keys{{"generator_version", kGeneratorVersion}};
  const std::string section = "data.train.";
  for (const auto& [key, value] : flat_config(config_text(run))) {
    if (key.starts_with(section) && key != section + "file") keys.emplace("data." + key.substr(section.size()), value);
    if (key.starts_with("env.navmesh.")) keys.emplace(key, value);
    for (const char* used : {"env.scene_root", "env.task.forward_m", "env.task.turn_deg", "env.task.success_radius_m", "env.task.max_steps",
                             "env.task.ear_height_m", "env.task.source_height_m", "env.task.motion"})
      if (key == used) keys.emplace(key, value);
  }
  // A goal of its own for each episode is what sets had before they could share any: those stay valid.
  if (data.goals_per_scene == 0) keys.erase("data.goals_per_scene");
  if (env.task.motion == Motion::continuous) keys.erase("env.task.motion");
  if (data.agents.count == 1) std::erase_if(keys, [](const auto& item) { return item.first.starts_with("data.agents."); });
  if (!data.scenario.changes_episodes()) std::erase_if(keys, [](const auto& item) { return item.first.starts_with("data.scenario."); });
  return keys;
}

std::map<std::string, std::string> expected_generator(const DataConfig& data, const EnvConfig& env) {
  return data.scenes.empty() ? std::map<std::string, std::string>{} : generator_keys(data, env);
}

void check_generator(const EpisodeSet& set, const std::map<std::string, std::string>& expected, const std::string& file,
                     const std::string& remedy) {
  if (expected.empty()) return;
  if (set.generator.empty()) throw InputError(file, "does not contain the keys that its episodes were made from", remedy);
  const auto changes = config_changes(set.generator, expected);
  if (changes.empty()) return;
  const std::string other_changes = changes.size() > 1 ? fmt::format(" ({} more keys differ)", changes.size() - 1) : "";
  throw InputError(file,
                   fmt::format("was made with {} = {}, but the config has {}{}", changes.front().key, changes.front().before,
                               changes.front().now, other_changes),
                   remedy);
}

}  // namespace earshot
