// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/config_key.h"
#include "sim/base/text/text_match.h"

namespace earshot {

/// Allowed values of one key of a config.
template <class T>
concept ConfigValue = std::same_as<T, bool> || std::same_as<T, int> || std::same_as<T, std::uint32_t> || std::same_as<T, std::int64_t> ||
    std::same_as<T, std::uint64_t> || std::same_as<T, float> || std::same_as<T, double> || std::same_as<T, std::string> ||
    std::same_as<T, std::vector<int>> || std::same_as<T, std::vector<std::uint64_t>> || std::same_as<T, std::vector<float>> ||
    std::same_as<T, std::vector<double>> || std::same_as<T, std::vector<std::string>> ||
    std::same_as<T, std::vector<std::vector<std::vector<double>>>>;

/// One map of a YAML file being read into a config struct.  A call of `read` declares its key: name, type, allowed values, default (the
/// value before the call) and description.  Parsing, checks, the error for an unknown key (`finish`) and the reference (`earshot config`)
/// all come from these calls, and no key is known without one.  A child map is finished by its own reader.  Copies share the map.  Not safe
/// from several threads.
///
///   ConfigReader reader = ConfigReader::from_file("train.yaml", overrides);
///   reader.read("lr", config.lr, Allowed::above(0), "Step of Adam.");   // missing key: the struct's default stays
///   ConfigReader task = reader.child("task", "Rules of an episode.");   // an absent child reads as an empty map
///   read(task, config.task); task.finish(); reader.finish();
class ConfigReader {
 public:
  /// overrides: "a.b.c=value" strings, applied in order after the file.  A top key `schema_version` is checked here and taken out.
  /// Throws InputError: missing file, not UTF-8, YAML that is wrong or means several things (yaml_parser.h, with line), not a map, an
  /// override without '=', a newer schema.
  static ConfigReader from_file(const std::filesystem::path& path, const std::vector<std::string>& overrides = {});
  /// where: how messages name the text.
  static ConfigReader from_text(std::string_view yaml, std::string where, const std::vector<std::string>& overrides = {});
  /// Reads nothing, so that every value stays, and records what each key holds: effective() is then the config as YAML, defaults included.
  static ConfigReader recorder();
  /// Reads nothing and collects the declarations: described().
  static ConfigReader describer();
  /// Reads nothing and checks that each value is allowed.  section: prefix of the keys in messages, "task"; may be empty.
  static ConfigReader checker(const std::string& section);
  /// The key that every YAML file may have at its top.
  static ConfigKey schema_version_key();

  /// Reads `key` into `value` if it is there.  Throws InputError naming file, line, key, value and what is allowed.
  template <ConfigValue T>
  void read(const std::string& key, T& value, const Allowed& allowed, About about);
  template <ConfigValue T>
  void read(const std::string& key, T& value, About about) {
    read(key, value, Allowed::any(), about);
  }
  /// A value without a default: nothing if the key is absent.
  template <ConfigValue T>
  void read(const std::string& key, std::optional<T>& value, const Allowed& allowed, About about) {
    if (has(key)) value.emplace();
    if (value) return read(key, *value, allowed, about);
    if (mode_ == Mode::recording || mode_ == Mode::checking) return;
    T absent{};
    read(key, absent, allowed, about);
    if (is_describing()) last_described().default_value.reset();
  }
  /// Like read; the key must be there.
  template <ConfigValue T>
  void read_required(const std::string& key, T& value, const Allowed& allowed, About about) {
    if (mode_ == Mode::parsing && !has(key)) fail(key, "is missing");
    read(key, value, allowed, about);
    if (!is_describing()) return;
    last_described().is_required = true;
    last_described().default_value.reset();
  }
  /// Reads one of the named choices into an enum or any value.
  template <class T>
  void read_choice(const std::string& key, T& value, const std::map<std::string, T>& choices, About about) {
    std::string current;
    std::vector<std::string> names;
    for (const auto& [choice, meaning] : choices) {
      names.push_back(choice);
      if (meaning == value) current = choice;
    }
    if (const std::optional<std::string> chosen = choose(key, current, names, about)) value = choices.at(*chosen);
  }

  /// Whether the map has a value under `key`.  Does not make the key known.
  [[nodiscard]] bool has(const std::string& key) const;
  /// Whether a key that is read only where it is given is to be read: it is there, or all keys are being described.  The key is known.
  [[nodiscard]] bool asks_for(const std::string& key) {
    known_.insert(key);
    return is_describing() || has(key);
  }
  /// The child map under `key`; empty if absent.  Throws InputError if the value is not a map.
  [[nodiscard]] ConfigReader child(const std::string& key, About about);
  /// The maps of the list under `key`; none if it is absent.  Throws InputError if the value is not a list of maps.
  [[nodiscard]] std::vector<ConfigReader> children(const std::string& key, About about);
  /// The keys of this map in file order, for maps whose keys are free; each is then read as any other.  A describer gives `placeholder`.
  [[nodiscard]] std::vector<std::string> free_keys(const std::string& placeholder) const;
  /// The text under `key`, to look at without reading it; nothing if it is absent or not a scalar.
  [[nodiscard]] std::optional<std::string> scalar(const std::string& key) const;
  /// Throws InputError if one of these keys is there, which another reader of the same map takes: left out of the reference.
  void refuse(const std::vector<std::string>& keys, const std::string& problem);

  /// Throws InputError for the first key that was never read.
  void finish() const;
  /// Throws InputError "where:line: path.key: problem".
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const;
  /// Path prefix of this map inside the file, with a trailing dot, or empty.
  [[nodiscard]] const std::string& prefix() const { return prefix_; }
  [[nodiscard]] const std::string& where() const { return where_; }
  [[nodiscard]] bool is_describing() const { return mode_ == Mode::describing; }
  /// The map as YAML text, overrides included.
  [[nodiscard]] std::string text() const;
  /// The same as "section.key" -> value as YAML on one line, for every value that is no map.
  [[nodiscard]] std::map<std::string, std::string> flat() const;
  /// Of a recorder: the recorded keys as YAML text.
  [[nodiscard]] std::string effective() const;
  /// Of a describer: every key in the order of its reader, without those that are refused.
  [[nodiscard]] std::vector<ConfigKey> described() const;

 private:
  enum class Mode { parsing, recording, describing, checking };
  struct Nodes;   ///< the YAML nodes, whose headers only config_reader.cpp includes
  struct Shared;  ///< by all readers of one file: overrides, and what is described

  ConfigReader(Nodes nodes, std::shared_ptr<Shared> shared, Mode mode, std::string where, std::string prefix);
  static ConfigReader without_file(Mode mode, const std::string& prefix);
  [[nodiscard]] std::optional<std::string> choose(const std::string& key, const std::string& current, const std::vector<std::string>& names,
                                                  About about);
  void describe(const ConfigKey& key);
  [[nodiscard]] ConfigKey& last_described();
  /// Where the value of a key stands: "file:line", or the override that set it.
  [[nodiscard]] std::string place_of(const std::string& key) const;

  std::shared_ptr<Nodes> nodes_;  ///< shared by copies
  std::shared_ptr<Shared> shared_;
  Mode mode_;
  std::string where_, prefix_;
  std::set<std::string> known_;
};

/// Throws InputError for the first value that its reader would refuse: the ranges of a config that was not read from a file.
/// section: prefix of the keys in messages; may be empty.
template <class Config>
void check_values(const Config& config, const std::string& section) {
  ConfigReader checker = ConfigReader::checker(section);
  Config copy = config;
  read(checker, copy);
}

/// All keys of a config, defaults as in `config`.
template <class Config>
std::vector<ConfigKey> keys_of(Config config = {}) {
  ConfigReader describer = ConfigReader::describer();
  read(describer, config);
  return describer.described();
}

}  // namespace earshot
