// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/replica_info.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>

#include "sim/base/errors.h"
#include "sim/base/text/json_size.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {
namespace {

/// Of the whole file: an honest one has some thousand instances, of some tens of numbers each.
constexpr JsonLimits kReplicaLimits{.values = 4'000'000, .texts = 1'000'000, .lists = 500'000};

class ReplicaInfo {
 public:
  explicit ReplicaInfo(const std::string& where) : where_(where), annotations_(where) {}

  Annotations take(const nlohmann::json& json) {
    if (!json.is_object() || (!json.contains("classes") && !json.contains("objects")))
      fail("is not an info_semantic.json: it has neither 'classes' nor 'objects'");
    if (json.contains("classes")) {
      const nlohmann::json& classes = list(json, "classes");
      for (std::size_t i = 0; i < classes.size(); ++i) take_class(classes[i], fmt::format("classes[{}]", i));
    }
    if (json.contains("objects")) {
      const nlohmann::json& objects = list(json, "objects");
      for (std::size_t i = 0; i < objects.size(); ++i) take_object(objects[i], fmt::format("objects[{}]", i));
    } else {
      for (const auto& [id, name] : classes_) annotations_.add(id, name);
    }
    return std::move(annotations_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(where_, problem, "copy the file again"); }

  [[nodiscard]] const nlohmann::json& list(const nlohmann::json& json, const char* key) const {
    if (!json[key].is_array()) fail(fmt::format("'{}' is not a list", key));
    return json[key];
  }

  [[nodiscard]] std::int64_t whole(const nlohmann::json& entry, const char* key, const std::string& place) const {
    if (!entry.is_object() || !entry.contains(key) || !entry[key].is_number_integer())
      fail(fmt::format("{}.{} is not a whole number", place, key));
    return entry[key].get<std::int64_t>();
  }

  [[nodiscard]] std::string text(const nlohmann::json& entry, const char* key, const std::string& place) const {
    if (!entry.contains(key) || !entry[key].is_string()) fail(fmt::format("{}.{} is not a text", place, key));
    return entry[key].get<std::string>();
  }

  void take_class(const nlohmann::json& entry, const std::string& place) {
    const std::int64_t id = whole(entry, "id", place);
    if (!classes_.try_emplace(id, text(entry, "name", place)).second) fail(fmt::format("{} has an id that occurs twice: {}", place, id));
  }

  void take_object(const nlohmann::json& entry, const std::string& place) {
    const std::int64_t id = whole(entry, "id", place), class_id = entry.contains("class_id") ? whole(entry, "class_id", place) : 0;
    if (class_id < 0) return annotations_.add(id, "");
    if (entry.contains("class_name")) return annotations_.add(id, text(entry, "class_name", place));
    const auto found = classes_.find(whole(entry, "class_id", place));
    if (found == classes_.end()) fail(fmt::format("{} has no class_name, and the class {} does not exist", place, class_id));
    annotations_.add(id, found->second);
  }

  const std::string& where_;
  Annotations annotations_;
  std::map<std::int64_t, std::string> classes_;
};

}  // namespace

Annotations parse_replica_info(std::string_view text, const std::string& where) {
  return ReplicaInfo(where).take(parse_sized_json(text, where, kReplicaLimits));
}

}  // namespace earshot
