// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim/scene/habitat/json_fields.h"

namespace earshot {

/// Attributes of a template or an instance from several JSON objects, of which the last one with a key decides.
class Attributes {
 public:
  void add(JsonFields fields) { layers_.push_back(std::move(fields)); }
  /// The object that decides about a key; null where none has it.
  [[nodiscard]] const JsonFields* with(const char* key) const;
  /// The last one, for messages about a key that is absent.  There is at least one.
  [[nodiscard]] const JsonFields& last() const { return layers_.back(); }
  void add_unknown(const std::set<std::string_view>& known, std::set<std::string>& unknown) const;

 private:
  std::vector<JsonFields> layers_;
};

/// A stage, an object or a scene that a data set lists.
struct DatasetTemplate {
  std::string handle;          ///< path relative to the config without the end of its kind, or the template_handle of the config
  std::filesystem::path file;  ///< its own JSON or, without one, its mesh; empty where the config holds it all
  bool is_mesh = false;        ///< file is a mesh
  const nlohmann::json* attributes = nullptr;  ///< of the config, over those of the file; null for none
};

/// The kinds of templates that are read.
enum class TemplateKind { stage, object, scene };

/// A `*.scene_dataset_config.json`: what it lists, by handle.  Files are looked up by their names alone, and read when a scene uses them.
class DatasetConfig {
 public:
  /// Throws InputError naming the file and the key: missing, no JSON, wrong types, paths that lead out of its folder.
  explicit DatasetConfig(const std::filesystem::path& path);

  /// By its whole handle, else by whole components at its end ("objects/chair" is "configs/objects/chair"); a name may end as the file
  /// does. Of a JSON and a mesh of the same handle it is the JSON.  Throws InputError naming `fields` and `key` where there is none or
  /// several.
  [[nodiscard]] const DatasetTemplate& find(TemplateKind kind, const std::string& handle, const JsonFields& fields, const char* key) const;
  /// null where there is none or several.
  [[nodiscard]] const DatasetTemplate* find_only(TemplateKind kind, const std::string& handle) const;
  [[nodiscard]] const std::vector<DatasetTemplate>& all(TemplateKind kind) const { return lists_[static_cast<std::size_t>(kind)]; }
  /// The defaults of the kind, the file of the template and its attributes in the config.  json: keeps the file of the template.
  [[nodiscard]] Attributes attributes_of(TemplateKind kind, const DatasetTemplate& found, nlohmann::json& json) const;
  /// File of a semantic scene descriptor by its handle; nullopt where the config lists none by handles.
  [[nodiscard]] std::optional<std::filesystem::path> descriptor(const std::string& handle, const JsonFields& fields, const char* key) const;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// The folder that all files of the data set lie in.
  [[nodiscard]] const std::filesystem::path& root() const { return root_; }

 private:
  void read_kind(TemplateKind kind);
  void read_paths(TemplateKind kind, const JsonFields& paths);
  void read_configs(TemplateKind kind, const nlohmann::json& configs, const std::string& place);
  [[nodiscard]] std::vector<const DatasetTemplate*> matches(TemplateKind kind, const std::string& handle) const;

  std::filesystem::path path_, root_;
  std::shared_ptr<const nlohmann::json> json_;  ///< shared: templates point into it
  std::vector<DatasetTemplate> lists_[3];
};

}  // namespace earshot
