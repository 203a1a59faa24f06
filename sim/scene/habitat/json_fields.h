// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace earshot {

/// A JSON file of a data set, up to 64 MiB.  Throws InputError naming the file: missing, too large, no JSON, a number beyond doubles, not
/// an object.
nlohmann::json read_json_object(const std::filesystem::path& path);
/// The same from its text.
nlohmann::json parse_json_object(std::string_view text, const std::string& where);

/// Values of one JSON object, checked.  Every getter gives nullopt for a key that is absent, and throws InputError naming the file and the
/// key for a value of another type or out of range.  It keeps a reference to the object.
class JsonFields {
 public:
  /// file: for messages, and the base of relative paths within.  place: of the object in the file ("object_instances[3]"), or empty.
  JsonFields(const nlohmann::json& json, std::filesystem::path file, std::string place);

  [[nodiscard]] bool has(const char* key) const { return json_->contains(key); }
  [[nodiscard]] std::optional<std::string> text(const char* key) const;
  [[nodiscard]] std::optional<double> number(const char* key, double lower, double upper) const;
  [[nodiscard]] std::optional<std::int64_t> whole(const char* key) const;
  /// Three numbers, each at most `largest` in size.
  [[nodiscard]] std::optional<glm::dvec3> vector(const char* key, double largest) const;
  /// Four numbers w, x, y, z of length 1 within 1 %; normalized.
  [[nodiscard]] std::optional<glm::dquat> rotation(const char* key) const;
  /// null for an absent key.
  [[nodiscard]] const nlohmann::json* list(const char* key) const;
  [[nodiscard]] const nlohmann::json* object(const char* key) const;
  /// "file: place.key problem; advice" as an InputError.
  [[noreturn]] void fail(std::string_view key, const std::string& problem, const std::string& advice) const;
  /// Keys of the object that are not among `known`, as "KEY in FILE".
  void add_unknown(const std::set<std::string_view>& known, std::set<std::string>& unknown) const;

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// "place.key" or "key".
  [[nodiscard]] std::string place_of(std::string_view key) const;

 private:
  const nlohmann::json* json_;
  std::filesystem::path file_;
  std::string place_;
};

}  // namespace earshot
