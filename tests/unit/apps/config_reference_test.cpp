// The reference of config keys against the readers and the shipped configs.

#include "apps/reference/config_reference.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/reference/config_pages.h"
#include "datasets/sound_scene_config.h"
#include "envs/config/batch_config.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/sweep.h"
#include "sim/audio/head/directivity.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/scene_config.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

using testing::HasSubstr;

const ConfigKind& kind_named(const std::vector<ConfigKind>& reference, const std::string& name) {
  for (const ConfigKind& kind : reference)
    if (kind.name == name) return kind;
  throw std::runtime_error("no kind " + name);
}

bool has_key(const ConfigKind& kind, const std::string& name) {
  return std::ranges::any_of(kind.keys, [&](const ConfigKey& key) { return stands_for(key, name); });
}

/// One kind of config: keys without which it cannot be read, and its reader.
struct KindUnderTest {
  std::vector<std::string> required;  ///< key=value
  std::function<void(const std::string& yaml)> read;
};

template <class Config>
KindUnderTest read_as(Config config, std::vector<std::string> required = {}) {
  return {std::move(required), [config](const std::string& yaml) {
            ConfigReader reader = ConfigReader::from_text(yaml, "a.yaml");
            Config copy = config;
            read(reader, copy);
            reader.finish();
          }};
}

std::map<std::string, KindUnderTest> kinds_under_test(const TempFolder& folder) {
  std::map<std::string, KindUnderTest> kinds;
  kinds["run config"] = read_as(RunConfig{});
  kinds["benchmark"] = {{"benchmark.name=a", "benchmark.version=1", "benchmark.set_hash=b", "benchmark.rules_hash=c"},
                        [](const auto& yaml) {
                          ConfigReader reader = ConfigReader::from_text(yaml, "a.yaml");
                          Benchmark benchmark;
                          RunConfig run;
                          read(reader, benchmark);
                          read(reader, run);
                          ConfigReader section = reader.child("benchmark", "Facts of the benchmark.");
                          static_cast<void>(read_tracks(section, run.env.observation));
                          reader.finish();
                        }};
  kinds["environment config"] = {{}, [](const auto& yaml) {
                                   ConfigReader reader = ConfigReader::from_text(yaml, "a.yaml");
                                   EnvConfig env;
                                   DataConfig data;
                                   read(reader, env);
                                   ConfigReader episodes = reader.child("episodes", "Episodes of the environments.");
                                   read(episodes, data);
                                   episodes.finish();
                                   reader.finish();
                                 }};
  kinds["sweep"] = read_as(SweepConfig{.name = "x", .out = {}, .config = {}, .seeds = {}, .runs = {}}, {"config=c.yaml", "seeds=[1]"});
  kinds["scene"] = {{"mesh=shoebox:3x3x3", "materials=m.json"},
                    [&](const auto& yaml) { static_cast<void>(read_scene_config(folder.write("a.yaml", yaml))); }};
  kinds["semantic materials"] = {{"categories={wall: [marble]}"},
                                 [](const auto& yaml) { static_cast<void>(SemanticMaterials::from_yaml(yaml, "a.yaml")); }};
  kinds["acoustic settings"] = read_as(AcousticConfig{});
  kinds["response corpus"] = read_as(RirCorpusConfig{});
  kinds["recording corpus"] = read_as(SoundSceneConfig{});
  kinds["microphone array"] = {{"microphones=[{position_m: [0, 0, 0]}]"},
                               [&](const auto& yaml) { static_cast<void>(ListenerLayout::from_file(folder.write("a.yaml", yaml))); }};
  kinds["directivity balloon"] = {{"frequencies_hz=[100, 1000]", "elevations_deg=[0]", "azimuths_deg=[0]", "gains_db=[[[0]], [[1]]]"},
                                  [](const auto& yaml) { static_cast<void>(Directivity::balloon_from_text(yaml, "a.yaml")); }};
  return kinds;
}

/// A name that a file may have in place of the placeholders.
std::string name_in_file(std::string name) {
  for (const std::string placeholder : {"NAME", "PATTERN", "CATEGORY"})
    if (const auto at = name.find(placeholder); at != std::string::npos) name.replace(at, placeholder.size(), "first");
  if (const auto at = name.find("[]"); at != std::string::npos) name.replace(at, 2, "[0]");
  return name;
}

/// The required keys of a kind, and one key with a value.
std::string text_with(const KindUnderTest& kind, const ConfigKey& key, const std::string& value) {
  if (key.name.starts_with("microphones[].")) {
    const std::string name = key.name.substr(key.name.find('.') + 1), place = name == "position_m" ? "" : "position_m: [0, 0, 0], ";
    return "microphones: [{" + place + name + ": " + value + "}]";
  }
  std::vector<std::string> settings = kind.required;
  settings.push_back(name_in_file(key.name) + "=" + value);
  return ConfigReader::from_text("", "base", settings).text();
}

std::string refusal_of(const KindUnderTest& kind, const std::string& yaml) {
  try {
    kind.read(yaml);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool is_number_key(const ConfigKey& key) {
  return key.type == KeyType::whole_number || key.type == KeyType::number || key.type == KeyType::whole_numbers ||
         key.type == KeyType::numbers;
}
bool is_whole(const ConfigKey& key) { return key.type == KeyType::whole_number || key.type == KeyType::whole_numbers; }
bool is_list(const ConfigKey& key) { return key.type == KeyType::whole_numbers || key.type == KeyType::numbers; }

std::string written(const ConfigKey& key, double number) {
  const std::string one = is_whole(key) ? fmt::format("{:.0f}", number) : fmt::format("{}", number);
  if (!is_list(key)) return one;
  std::string list = one;
  for (int i = 1; i < key.allowed.count; ++i) list += ", " + one;
  return "[" + list + "]";
}

/// Numbers beyond the bounds of a key: the bound itself where it is open, and one at random further out.
std::vector<double> numbers_beyond(const ConfigKey& key, const RandomStream& random) {
  std::vector<double> numbers;
  const Allowed& allowed = key.allowed;
  const double far = 2 + std::floor(1e4 * static_cast<double>(random.uniform(0)));
  if (std::isfinite(allowed.low)) {
    numbers.push_back(allowed.low - far);
    if (allowed.is_low_open) numbers.push_back(allowed.low);
  }
  if (std::isfinite(allowed.high)) {
    numbers.push_back(allowed.high >= 1e9 ? 3 * allowed.high : allowed.high + far);
    if (allowed.is_high_open) numbers.push_back(allowed.high);
  }
  std::erase_if(numbers, [&](double number) { return allowed.other && number == *allowed.other; });
  return numbers;
}

TEST(ConfigReference, EveryKeyHasASentenceAndANameOfItsOwn) {
  std::size_t number = 0;
  for (const ConfigKind& kind : config_reference()) {
    std::set<std::string> names;
    EXPECT_TRUE(kind.about.ends_with('.')) << kind.name;
    EXPECT_FALSE(kind.keys.empty()) << kind.name;
    for (const ConfigKey& key : kind.keys) {
      EXPECT_TRUE(key.about.size() > 8 && key.about.ends_with('.')) << key.name << ": " << key.about;
      EXPECT_TRUE(names.insert(key.name).second) << kind.name << " has " << key.name << " twice";
      EXPECT_TRUE(key.type != KeyType::choice || key.choices.size() >= 2) << key.name;
      number += key.type == KeyType::section ? 0 : 1;
    }
  }
  EXPECT_GT(number, 400u);
}

TEST(ConfigReference, EveryKeyOfEveryShippedConfigIsInIt) {
  const std::vector<ConfigKind> reference = config_reference();
  const std::filesystem::path configs = source_dir() / "configs";
  std::vector<std::pair<std::string, std::filesystem::path>> files{{"response corpus", configs / "datasets/rir.yaml"},
                                                                   {"recording corpus", configs / "datasets/scenes.yaml"},
                                                                   {"semantic materials", configs / "semantic_materials.yaml"}};
  for (const auto& [kind, folder] :
       std::map<std::string, std::string>{{"run config", "train"}, {"benchmark", "benchmarks"}, {"sweep", "sweeps"}, {"scene", "scenes"}})
    for (const auto& entry : std::filesystem::directory_iterator(configs / folder))
      if (entry.path().extension() == ".yaml") files.emplace_back(kind, entry.path());
  EXPECT_GE(files.size(), 15u);
  for (const auto& [kind, file] : files)
    for (const auto& [name, value] : flat_config(read_file(file)))
      EXPECT_TRUE(has_key(kind_named(reference, kind), name)) << file << ": " << name;
  for (const auto& material : parse_json(read_file(configs / "materials.json")).at("materials"))
    for (const auto& [name, value] : material.items())
      EXPECT_TRUE(has_key(kind_named(reference, "material database"), "materials[]." + name)) << name;
}

// What the program writes of a config with every key, checkpoints among it.
TEST(ConfigReference, EveryKeyOfAWrittenConfigIsInIt) {
  const ConfigKind run = kind_named(config_reference(), "run config");
  for (const auto& [name, value] : flat_config(config_text(RunConfig{}))) EXPECT_TRUE(has_key(run, name)) << name;
}

TEST(ConfigReference, DefaultsAreTakenAsTheyArePrinted) {
  const TempFolder folder;
  const auto kinds = kinds_under_test(folder);
  for (const ConfigKind& kind : config_reference()) {
    if (!kinds.contains(kind.name)) continue;  // JSON: materials_test.cpp
    for (const ConfigKey& key : kind.keys)
      if (key.default_value) {
        EXPECT_EQ(refusal_of(kinds.at(kind.name), text_with(kinds.at(kind.name), key, *key.default_value)), "")
            << kind.name << ": " << key.name;
      }
  }
}

TEST(ConfigReference, WhatIsBeyondARangeIsRefusedByKeyValueAndRange) {
  const TempFolder folder;
  const auto kinds = kinds_under_test(folder);
  std::uint32_t draw = 0;
  std::size_t number = 0;
  for (const ConfigKind& kind : config_reference()) {
    if (!kinds.contains(kind.name)) continue;
    for (const ConfigKey& key : kind.keys) {
      if (!is_number_key(key) || key.name == "schema_version") continue;
      ++draw;
      for (const double beyond : numbers_beyond(key, RandomStream(5, Purpose::test, draw))) {
        ++number;
        const std::string value = written(key, beyond),
                          message = refusal_of(kinds.at(kind.name), text_with(kinds.at(kind.name), key, value));
        EXPECT_THAT(message, HasSubstr(name_in_file(key.name) + " is " + value + "; use " + wanted_text(key))) << kind.name;
        EXPECT_THAT(message, testing::ContainsRegex("a\\.yaml:[0-9]+: ")) << kind.name;
      }
    }
  }
  EXPECT_GT(number, 400u);
}

TEST(ConfigReference, TheBoundsOfARangeAreTaken) {
  const TempFolder folder;
  const auto kinds = kinds_under_test(folder);
  for (const ConfigKind& kind : config_reference()) {
    if (!kinds.contains(kind.name)) continue;
    for (const ConfigKey& key : kind.keys) {
      if (key.type != KeyType::whole_number && key.type != KeyType::number) continue;
      std::vector<double> bounds;
      if (std::isfinite(key.allowed.low) && !key.allowed.is_low_open) bounds.push_back(key.allowed.low);
      if (std::isfinite(key.allowed.high) && !key.allowed.is_high_open && key.allowed.high < 1e10) bounds.push_back(key.allowed.high);
      if (key.allowed.other) bounds.push_back(*key.allowed.other);
      for (const double bound : bounds) {
        const std::string message = refusal_of(kinds.at(kind.name), text_with(kinds.at(kind.name), key, written(key, bound)));
        // Two keys may contradict each other.
        if (message.find("has no effect") == std::string::npos) {
          EXPECT_EQ(message, "") << kind.name << ": " << key.name;
        }
      }
    }
  }
}

TEST(ConfigReference, ValuesOfAnotherTypeAreRefused) {
  const TempFolder folder;
  const auto kinds = kinds_under_test(folder);
  for (const ConfigKind& kind : config_reference()) {
    if (!kinds.contains(kind.name)) continue;
    for (const ConfigKey& key : kind.keys) {
      const std::string value = key.type == KeyType::section ? "3" : "[[[[x]]]]", name = name_in_file(key.name);
      if (name == "schema_version" || name == "microphones[0]") continue;
      EXPECT_THAT(refusal_of(kinds.at(kind.name), text_with(kinds.at(kind.name), key, value)), HasSubstr(name)) << kind.name;
    }
  }
}

// A reader of another file would be missing in the reference.
TEST(ConfigReference, NoOtherSourceReadsAFile) {
  const std::set<std::string> known{
      "api/config.cpp",                          // acoustic settings
      "api/datasets/dataset.cpp",                // corpora
      "api/episodes.cpp",                        // keys of an environment config
      "api/scene.cpp",                           // acoustic settings
      "apps/bench/bench_bits.cpp",               // environment config
      "apps/dataset/dataset_pano.cpp",           // keys of a response corpus
      "apps/options/acoustic_options.cpp",       // acoustic settings
      "apps/scene/scene.cpp",                    // acoustic settings
      "datasets/rir_corpus_config.cpp",          // response corpus
      "datasets/sound_scene_config.cpp",         // recording corpus
      "envs/batch/quarantine_replay.cpp",        // environment config, as a run wrote it
      "envs/config/batch_config.cpp",            // environment config
      "evaluation/leaderboard/benchmark.cpp",    // benchmark
      "evaluation/leaderboard/sweep.cpp",        // sweep
      "evaluation/results/sensed_config.cpp",    // keys of an environment config
      "evaluation/results/metric_rules.cpp",     // keys of an environment config
      "sim/audio/head/balloon_directivity.cpp",  // directivity balloon
      "sim/audio/head/listener_layout.cpp",      // microphone array
      "sim/base/text/config_reader.cpp",
      "sim/scene/materials/semantic_materials.cpp",  // semantic materials
      "sim/scene/scene_config.cpp",                  // scene
      "sim/scene/scene_inputs.cpp",                  // looks at a scene, for its hash
      "trainer/run/planned_acoustics.cpp",           // written by the program, not by its users
      "trainer/run/run_config.cpp",                  // run config
  };
  std::set<std::string> found;
  for (const char* part : {"sim", "api", "envs", "datasets", "policy", "trainer", "evaluation", "bench", "apps", "python/src"})
    for (const auto& entry : std::filesystem::recursive_directory_iterator(source_dir() / part)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
      const std::string text = read_file(entry.path());
      if (text.find("ConfigReader::from_") != std::string::npos)
        found.insert(std::filesystem::relative(entry.path(), source_dir()).generic_string());
    }
  found.erase("sim/base/text/config_reader.h");
  EXPECT_EQ(found, known) << "add its keys to config_reference(), or say here what it reads";
}

TEST(ConfigReference, NamesOfFilesStandForPlaceholders) {
  const ConfigKey camera{.name = "env.observation.cameras.NAME.width_px"}, item{.name = "microphones[].position_m"};
  EXPECT_TRUE(stands_for(camera, "env.observation.cameras.back.width_px"));
  EXPECT_FALSE(stands_for(camera, "env.observation.cameras.back.height_px"));
  EXPECT_FALSE(stands_for(camera, "env.observation.cameras.back"));
  EXPECT_TRUE(stands_for(item, "microphones[3].position_m"));
  EXPECT_TRUE(stands_for(item, "microphones.position_m"));
}

TEST(ConfigReference, TheNearestKeyIsFoundByItsPathOrItsLastPart) {
  const std::vector<ConfigKind> reference = config_reference();
  EXPECT_EQ(nearest_key(reference, "ppo.clp"), "ppo.clip");
  EXPECT_EQ(nearest_key(reference, "env.acoustics.ray"), "env.acoustics.rays");
  EXPECT_EQ(nearest_key(reference, "learning_rate"), "ppo.learning_rate");
  EXPECT_EQ(nearest_key(reference, "learnin_rate"), "ppo.learning_rate");
  EXPECT_EQ(nearest_key(reference, "zzzzzzzzzzzz"), "");
}

TEST(ConfigReference, PagesHoldEveryKey) {
  const std::vector<ConfigKind> reference = config_reference();
  const std::string text = reference_text(reference, 100), page = reference_markdown(reference);
  const auto json = parse_json(reference_json(reference, ""));
  EXPECT_EQ(json.at("schema_version"), 1);
  for (const ConfigKind& kind : reference) {
    EXPECT_THAT(text, HasSubstr("\n" + std::string(kind.name.size(), '=') + "\n"));
    for (const ConfigKey& key : kind.keys) {
      if (kind.name == "run config" || kind.name == "scene") {
        EXPECT_THAT(key_text(reference, key.name, 100), HasSubstr(name_in_section(key))) << key.name;
      }
      EXPECT_THAT(page, HasSubstr(name_in_section(key)));
      EXPECT_THAT(text, HasSubstr(name_in_section(key)));
    }
  }
  for (const ConfigKey& key : kind_named(reference, "run config").keys)
    if (key.type != KeyType::section) {
      EXPECT_THAT(page, HasSubstr("| `" + name_in_section(key) + "` |")) << key.name;
    }
  EXPECT_EQ(json.at("kinds").size(), reference.size());
}

}  // namespace
}  // namespace earshot
