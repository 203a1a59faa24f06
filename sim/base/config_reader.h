#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

/// One map of a YAML file being read into a config struct.  Every key asked for is known; `finish` rejects the rest and
/// names the nearest known key.  A child map is finished by its own reader.
///
///   ConfigReader reader = ConfigReader::from_file("train.yaml", overrides);
///   reader.read("lr", config.lr);                    // missing key: the struct's default stays
///   ConfigReader task = reader.child("task");         // an absent child reads as an empty map
///   read(task, config.task); task.finish(); reader.finish();
class ConfigReader {
 public:
  /// overrides: "a.b.c=value" strings, applied in order after the file.  Throws InputError: missing file, not UTF-8, YAML
  /// syntax (with line), not a map, an override without '='.
  static ConfigReader from_file(const std::filesystem::path& path, const std::vector<std::string>& overrides = {});
  /// where: how messages name the text.
  static ConfigReader from_text(std::string_view yaml, std::string where, const std::vector<std::string>& overrides = {});
  /// Reads nothing, so that every value stays, and notes what each key holds: effective() is then the config as YAML, defaults included.
  static ConfigReader recorder();

  /// Reads `key` into `value` if it is there.  Throws InputError naming file, key, value and the wanted type.
  template <class T>
  void read(const std::string& key, T& value) {
    if (const YAML::Node node = find(key)) {
      try {
        value = node.as<T>();
      } catch (const YAML::Exception&) {
        fail(key, "'" + shown(node) + "' cannot be read as " + type_name<T>());
      }
    }
    if (records_) effective_[key] = value;
  }
  /// Like read; the key must be there.
  template <class T>
  void read_required(const std::string& key, T& value) {
    if (!has(key)) fail(key, "is missing");
    read(key, value);
  }
  /// Reads one of the named choices into an enum or any value.
  template <class T>
  void read_choice(const std::string& key, T& value, const std::map<std::string, T>& choices) {
    std::string name;
    if (records_)
      for (const auto& [choice, meaning] : choices)
        if (meaning == value) effective_[key] = choice;
    if (!has(key)) return;
    read(key, name);
    const auto found = choices.find(name);
    if (found == choices.end()) {
      std::string all;
      for (const auto& [choice, unused] : choices) all += (all.empty() ? "" : ", ") + choice;
      fail(key, "'" + name + "' is none of: " + all);
    }
    value = found->second;
  }

  [[nodiscard]] bool has(const std::string& key);
  /// The child map under `key`; empty if absent.  Throws InputError if the value is not a map.
  [[nodiscard]] ConfigReader child(const std::string& key);
  /// The raw node under `key` (undefined node if absent), for lists and free-form maps; counts as read.
  [[nodiscard]] YAML::Node node(const std::string& key);
  /// All keys of this map in file order, for maps with free keys; they count as read.
  [[nodiscard]] std::vector<std::string> keys();

  /// Throws InputError for the first key that nobody asked for.
  void finish() const;
  /// Throws InputError "where: path.key: problem".
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const;
  /// Path prefix of this map inside the file, with a trailing dot, or empty.
  [[nodiscard]] const std::string& prefix() const { return prefix_; }
  [[nodiscard]] const std::string& where() const { return where_; }
  /// The map as YAML text, overrides included.
  [[nodiscard]] std::string text() const;
  /// Of a recorder: what was noted, as YAML text.
  [[nodiscard]] std::string effective() const;

 private:
  ConfigReader(YAML::Node map, std::string where, std::string prefix);
  YAML::Node find(const std::string& key);
  static std::string shown(const YAML::Node& node);
  template <class T>
  static std::string type_name() {
    if constexpr (std::is_same_v<T, bool>)
      return "true or false";
    else if constexpr (std::is_integral_v<T>)
      return "a whole number in range";
    else if constexpr (std::is_floating_point_v<T>)
      return "a number";
    else if constexpr (std::is_same_v<T, std::string>)
      return "text";
    else
      return "the list that this key takes";
  }

  YAML::Node map_;
  std::string where_, prefix_;
  std::set<std::string> known_;
  bool records_ = false;
  YAML::Node effective_;  ///< shared with the reader of the parent map
};

/// The candidate nearest to `word` by edit distance, or empty if none is within a third of its length.
std::string nearest_word(std::string_view word, const std::set<std::string>& candidates);

}  // namespace earshot
