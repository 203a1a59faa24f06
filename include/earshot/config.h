// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Settings by key and config texts.

#include <concepts>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "earshot/errors.h"

namespace earshot::api {

/// Values by key, as `key=value` on the command line.
///
/// \code
/// const earshot::Settings settings{{"rays", 4096}, {"diffraction", false}, {"rir_length_s", "auto"}};
/// \endcode
class Settings {
 public:
  /// A number, a text, or a switch: true is written as `on`, false as `off`.
  class Value {
   public:
    Value(bool on) : text_(on ? "on" : "off") {}
    template <std::integral Number>
    Value(Number number) : text_(std::to_string(number)) {}
    Value(double number);  ///< shortest text that gives the same number
    Value(const char* text) : text_(text) {}
    Value(std::string text) : text_(std::move(text)) {}
    [[nodiscard]] const std::string& text() const { return text_; }

   private:
    std::string text_;
  };

  Settings() = default;
  Settings(std::initializer_list<std::pair<std::string, Value>> values);
  /// @param texts  "key=value" each; keys of sections are joined by dots, "env.task.max_steps=200".
  explicit Settings(std::vector<std::string> texts) : texts_(std::move(texts)) {}

  /// Adds a value; of a key that is set twice the last value counts.
  void set(const std::string& key, const Value& value) { texts_.push_back(key + "=" + value.text()); }
  [[nodiscard]] const std::vector<std::string>& texts() const { return texts_; }

 private:
  std::vector<std::string> texts_;
};

/// A config as text: YAML (or JSON, which is part of YAML) and settings that replace single keys.  Functions that take a config say which
/// keys they read.
struct Config {
  std::string yaml = {};
  std::string where = "config";  ///< name of the text in messages
  Settings overrides = {};

  /// @throws InputError if the file cannot be read.
  static Config from_file(const std::filesystem::path& path, Settings overrides = {});
  static Config from_text(std::string yaml, Settings overrides = {}) { return {std::move(yaml), "config", std::move(overrides)}; }
};

/// Every acoustic key with its value as YAML: preset `fast`, `balanced` or `high`, then `settings` over it.  docs/explanation/acoustics.md
/// describes the keys.
/// @throws InputError for an unknown preset or key, or a value out of range.
std::string acoustic_config_text(const std::string& preset, const Settings& settings = {});

/// A file that a call reads, or all files of one scene.  Equal hashes mean equal bytes.
struct InputFile {
  std::string name;  ///< path, or the name of the scene or sound
  std::uint64_t hash = 0;
  friend bool operator==(const InputFile&, const InputFile&) = default;
};

}  // namespace earshot::api
