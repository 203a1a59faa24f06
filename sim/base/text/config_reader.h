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

namespace earshot {

/// What one key of a config can hold.
template <class T>
concept ConfigValue = std::same_as<T, bool> || std::same_as<T, int> || std::same_as<T, std::uint32_t> || std::same_as<T, std::int64_t> ||
    std::same_as<T, std::uint64_t> || std::same_as<T, float> || std::same_as<T, double> || std::same_as<T, std::string> ||
    std::same_as<T, std::vector<int>> || std::same_as<T, std::vector<float>> || std::same_as<T, std::vector<double>> ||
    std::same_as<T, std::vector<std::string>> || std::same_as<T, std::vector<std::vector<std::vector<double>>>>;

/// One map of a YAML file being read into a config struct.  Every key that is read is known; `finish` rejects the rest with
/// the nearest known key.  A child map is finished by its own reader.  Copies share the map.  Not safe from several threads.
///
///   ConfigReader reader = ConfigReader::from_file("train.yaml", overrides);
///   reader.read("lr", config.lr);                    // missing key: the struct's default stays
///   ConfigReader task = reader.child("task");         // an absent child reads as an empty map
///   read(task, config.task); task.finish(); reader.finish();
class ConfigReader {
 public:
  /// overrides: "a.b.c=value" strings, applied in order after the file.  A top key `schema_version` is checked here and taken out.
  /// Throws InputError: missing file, not UTF-8, YAML syntax (with line), not a map, an override without '=', a newer schema.
  static ConfigReader from_file(const std::filesystem::path& path, const std::vector<std::string>& overrides = {});
  /// where: how messages name the text.
  static ConfigReader from_text(std::string_view yaml, std::string where, const std::vector<std::string>& overrides = {});
  /// Reads nothing, so that every value stays, and records what each key holds: effective() is then the config as YAML, defaults included.
  static ConfigReader recorder();

  /// Reads `key` into `value` if it is there.  Throws InputError naming file, key, value and the wanted type.
  template <ConfigValue T>
  void read(const std::string& key, T& value);
  /// Like read; the key must be there.
  template <ConfigValue T>
  void read_required(const std::string& key, T& value) {
    if (!has(key)) fail(key, "is missing");
    read(key, value);
  }
  /// Reads one of the named choices into an enum or any value.
  template <class T>
  void read_choice(const std::string& key, T& value, const std::map<std::string, T>& choices) {
    if (records_)
      for (const auto& [choice, meaning] : choices)
        if (meaning == value) record(key, choice);
    if (!has(key)) return;
    std::string name;
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
  /// The text under `key`; nothing if it is absent or not a scalar.  For maps with free keys.
  [[nodiscard]] std::optional<std::string> scalar(const std::string& key);
  /// Number of items of the list under `key`; nothing if it is absent or not a list.
  [[nodiscard]] std::optional<std::size_t> list_size(const std::string& key);
  /// Item `index` of the list under `key`, which holds more than `index` items.  Text: nothing if the item is not a scalar.
  [[nodiscard]] std::optional<std::string> list_scalar(const std::string& key, std::size_t index);
  /// The same for a list of maps; messages of the child name it "where key[index]".  Throws InputError if the item is not a map.
  [[nodiscard]] ConfigReader list_child(const std::string& key, std::size_t index);
  /// All keys of this map in file order, for maps with free keys; they count as read.
  [[nodiscard]] std::vector<std::string> keys();

  /// Throws InputError for the first key that was never read.
  void finish() const;
  /// Throws InputError "where: path.key: problem".
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const;
  /// Path prefix of this map inside the file, with a trailing dot, or empty.
  [[nodiscard]] const std::string& prefix() const { return prefix_; }
  [[nodiscard]] const std::string& where() const { return where_; }
  /// The map as YAML text, overrides included.
  [[nodiscard]] std::string text() const;
  /// Of a recorder: what was recorded, as YAML text.
  [[nodiscard]] std::string effective() const;

 private:
  struct Nodes;  ///< the YAML nodes, whose headers only config_reader.cpp includes

  ConfigReader(Nodes nodes, std::string where, std::string prefix);
  void record(const std::string& key, const std::string& choice);

  std::shared_ptr<Nodes> nodes_;  ///< shared by copies
  std::string where_, prefix_;
  std::set<std::string> known_;
  bool records_ = false;
};

/// The candidate nearest to `word` by edit distance, or empty if none is within a third of its length.
std::string nearest_word(std::string_view word, const std::set<std::string>& candidates);

}  // namespace earshot
