// SPDX-License-Identifier: Apache-2.0
#include "apps/reference/config_reference.h"

#include <algorithm>
#include <cctype>
#include <set>

#include "datasets/measured/measured_room.h"
#include "datasets/sound_scene_config.h"
#include "envs/config/batch_config.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/sweep.h"
#include "sim/audio/head/directivity.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/base/text/config_reader.h"
#include "sim/scene/materials/material_keys.h"
#include "sim/scene/materials/semantic_materials.h"
#include "sim/scene/scene_config.h"

namespace earshot {
namespace {

/// Files may state their version at the top.
std::vector<ConfigKey> with_version(std::vector<ConfigKey> keys) {
  keys.insert(keys.begin(), ConfigReader::schema_version_key());
  return keys;
}

std::vector<ConfigKey> benchmark_keys() {
  std::vector<ConfigKey> keys = keys_of<Benchmark>();
  const std::vector<ConfigKey> run = keys_of<RunConfig>();
  keys.insert(keys.end(), run.begin(), run.end());
  return keys;
}

std::vector<ConfigKey> sweep_keys() { return keys_of(SweepConfig{.name = "NAME", .out = {}, .config = {}, .seeds = {}, .runs = {}}); }

std::vector<std::string> parts_of(const std::string& name) {
  std::vector<std::string> parts(1);
  for (const char c : name) {
    if (c == '.')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

bool is_placeholder(const std::string& part) {
  return std::ranges::all_of(part, [](unsigned char c) { return std::isupper(c) != 0; });
}

std::string without_index(const std::string& part) { return part.substr(0, part.find('[')); }

std::string section_of(const std::string& name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string::npos ? "" : name.substr(0, dot);
}

}  // namespace

std::vector<ConfigKind> config_reference() {
  return {
      {"run config", "A training run, read by earshot train, plan, eval and others; configs/train.", with_version(keys_of<RunConfig>())},
      {"benchmark", "A fixed task that agents are ranked on, read by earshot benchmark, eval, verify and leaderboard; configs/benchmarks.",
       with_version(benchmark_keys())},
      {"environment config", "Environments without a training, read by Python's make_vec and earshot bench bits.",
       with_version(env_config_keys())},
      {"sweep", "Variants of a run config, trained with several seeds by earshot sweep; configs/sweeps.", with_version(sweep_keys())},
      {"scene", "A mesh with its materials and air, a SCENE of every command; configs/scenes.", with_version(scene_config_keys())},
      {"material database", "Coefficients of materials (JSON), named by the key materials of a scene; configs/materials.json.",
       material_database_keys()},
      {"semantic materials", "Materials by semantic category, named by the key semantics of a scene; configs/semantic_materials.yaml.",
       with_version(SemanticMaterials::keys())},
      {"acoustic settings", "Keys of --set of earshot rir, walk, scene and bench, and settings in Python.", keys_of<AcousticConfig>()},
      {"response corpus", "A corpus of room impulse responses, read by earshot dataset rir; configs/datasets/rir.yaml.",
       with_version(keys_of<RirCorpusConfig>())},
      {"recording corpus", "Recordings of sound scenes with labels, read by earshot dataset scenes; configs/datasets/scenes.yaml.",
       with_version(keys_of<SoundSceneConfig>())},
      {"measured room", "Places of measured responses, read by earshot validate and fit-materials; configs/measured.",
       with_version(places_keys())},
      {"microphone array", "Microphones of --channels array:FILE (YAML or JSON).", with_version(ListenerLayout::keys())},
      {"directivity balloon", "A measured directional pattern of a source or microphone (YAML or JSON).",
       with_version(Directivity::balloon_keys())},
  };
}

bool stands_for(const ConfigKey& key, const std::string& name) {
  const std::vector<std::string> pattern = parts_of(key.name), parts = parts_of(name);
  return std::ranges::equal(pattern, parts, [](const std::string& wanted, const std::string& part) {
    return is_placeholder(wanted) || wanted == part || without_index(wanted) == without_index(part);
  });
}

std::vector<KeyGroup> groups_of(const ConfigKind& kind) {
  std::vector<KeyGroup> groups{{.section = "", .about = kind.about, .keys = {}}};
  for (const ConfigKey& key : kind.keys) {
    if (key.type == KeyType::section) {
      groups.push_back({.section = key.name, .about = key.about, .keys = {}});
      continue;
    }
    const auto group = std::ranges::find_if(groups, [&](const KeyGroup& other) { return other.section == section_of(key.name); });
    if (group == groups.end())
      groups.push_back({.section = section_of(key.name), .about = "", .keys = {key}});
    else
      group->keys.push_back(key);
  }
  return groups;
}

std::string name_in_section(const ConfigKey& key) {
  const std::size_t dot = key.name.rfind('.');
  return dot == std::string::npos ? key.name : key.name.substr(dot + 1);
}

std::string nearest_key(const std::vector<ConfigKind>& reference, const std::string& name) {
  std::set<std::string> all, last_parts;
  for (const ConfigKind& kind : reference)
    for (const ConfigKey& key : kind.keys) {
      if (name_in_section(key) == name) return key.name;
      all.insert(key.name);
      last_parts.insert(name_in_section(key));
    }
  if (std::string nearest = nearest_word(name, all); !nearest.empty()) return nearest;
  const std::string last = nearest_word(parts_of(name).back(), last_parts);
  return last.empty() ? last : nearest_key(reference, last);
}

}  // namespace earshot
