// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/dataset_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/habitat/dataset_files.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_import.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

struct Kind {
  const char *key, *end, *name;
};

constexpr std::array<Kind, 3> kKinds{{{"stages", ".stage_config.json", "stage"},
                                      {"objects", ".object_config.json", "object"},
                                      {"scene_instances", ".scene_instance.json", "scene"}}};

const Kind& kind_of(TemplateKind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

/// A handle without the end of its kind, and without "./" and doubled slashes.
std::string bare_handle(const std::string& handle, const Kind& kind) {
  std::string bare = fs::path(handle).lexically_normal().generic_string();
  if (ends_with_folded(bare, kind.end)) {
    bare.resize(bare.size() - std::string_view(kind.end).size());
  } else if (is_mesh_file(bare)) {
    bare = fs::path(bare).replace_extension().generic_string();
  }
  return bare;
}

bool ends_in_components(const std::string& path, const std::string& end) {
  return path == end || (path.size() > end.size() && path.ends_with(end) && path[path.size() - end.size() - 1] == '/');
}

/// The end of a path with as many components as `like` has.
std::string last_components(const std::string& path, const std::string& like) {
  std::size_t begin = path.size();
  for (auto left = std::count(like.begin(), like.end(), '/'); left >= 0 && begin != std::string::npos && begin > 0; --left)
    begin = path.rfind('/', begin - 1);
  return begin == std::string::npos ? path : path.substr(begin + 1);
}

}  // namespace

const JsonFields* Attributes::with(const char* key) const {
  for (auto layer = layers_.rbegin(); layer != layers_.rend(); ++layer)
    if (layer->has(key)) return &*layer;
  return nullptr;
}

void Attributes::add_unknown(const std::set<std::string_view>& known, std::set<std::string>& unknown) const {
  for (const JsonFields& layer : layers_) layer.add_unknown(known, unknown);
}

DatasetConfig::DatasetConfig(const fs::path& path)
    : path_(path), root_(path.parent_path().lexically_normal()), json_(std::make_shared<nlohmann::json>(read_json_object(path))) {
  for (const TemplateKind kind : {TemplateKind::stage, TemplateKind::object, TemplateKind::scene}) read_kind(kind);
}

void DatasetConfig::read_kind(TemplateKind kind) {
  const JsonFields top(*json_, path_, "");
  const std::string key = kind_of(kind).key;
  const nlohmann::json* section = top.object(key.c_str());
  if (!section) return;
  const JsonFields fields(*section, path_, key);
  static_cast<void>(fields.object("default_attributes"));
  if (const nlohmann::json* paths = fields.object("paths")) read_paths(kind, JsonFields(*paths, path_, key + ".paths"));
  if (const nlohmann::json* configs = fields.list("configs")) read_configs(kind, *configs, key + ".configs");
}

void DatasetConfig::read_paths(TemplateKind kind, const JsonFields& paths) {
  const nlohmann::json& section = (*json_)[kind_of(kind).key]["paths"];
  for (const auto& [extension, list] : section.items()) {
    if (!list.is_array()) paths.fail(extension, "is not a list", "write a list of paths");
    const bool is_json = fold_case(extension) == ".json";
    if (!is_json && (kind == TemplateKind::scene || !is_mesh_file("x" + extension))) continue;  // .urdf and the like: no mesh
    for (const nlohmann::json& entry : list) {
      if (!entry.is_string()) paths.fail(extension, "holds something else than texts", "write a list of paths");
      const fs::path pattern = path_within(root_, root_, entry.get<std::string>(), paths, extension.c_str());
      for (const fs::path& file : find_files(pattern, is_json ? kind_of(kind).end : extension)) {
        const fs::path below = file.lexically_relative(root_.empty() ? fs::path(".") : root_);
        lists_[static_cast<std::size_t>(kind)].push_back(
            {.handle = bare_handle(below.generic_string(), kind_of(kind)), .file = file, .is_mesh = !is_json});
      }
    }
  }
}

void DatasetConfig::read_configs(TemplateKind kind, const nlohmann::json& configs, const std::string& place) {
  for (std::size_t i = 0; i < configs.size(); ++i) {
    const JsonFields fields(configs[i], path_, fmt::format("{}[{}]", place, i));
    DatasetTemplate made;
    if (const auto original = fields.text("original_file")) {
      made.file = path_within(root_, root_, *original, fields, "original_file");
      made.is_mesh = is_mesh_file(made.file);
      if (!made.is_mesh && !ends_with_folded(made.file.filename().string(), kind_of(kind).end))
        fields.fail("original_file", fmt::format("is no file of a {}", kind_of(kind).name), fmt::format("name a *{}", kind_of(kind).end));
    }
    const auto handle = fields.text("template_handle");
    if (!handle && made.file.empty()) fields.fail("template_handle", "is missing", "name the template");
    made.handle =
        bare_handle(handle ? *handle : made.file.lexically_relative(root_.empty() ? fs::path(".") : root_).generic_string(), kind_of(kind));
    made.attributes = fields.object("attributes");
    // Without a handle of its own it changes the file itself.
    std::vector<DatasetTemplate>& list = lists_[static_cast<std::size_t>(kind)];
    if (!handle) std::erase_if(list, [&](const DatasetTemplate& other) { return other.file == made.file; });
    list.push_back(std::move(made));
  }
}

std::vector<const DatasetTemplate*> DatasetConfig::matches(TemplateKind kind, const std::string& handle) const {
  const std::string bare = bare_handle(handle, kind_of(kind));
  std::vector<const DatasetTemplate*> whole, partial;
  for (const DatasetTemplate& one : all(kind)) {
    if (one.handle == bare) whole.push_back(&one);
    if (ends_in_components(one.handle, bare)) partial.push_back(&one);
  }
  std::vector<const DatasetTemplate*>& found = whole.empty() ? partial : whole;
  // A mesh beside its own JSON is what that JSON describes.
  const auto has_json = [&](const DatasetTemplate* mesh) {
    return std::any_of(found.begin(), found.end(),
                       [&](const DatasetTemplate* one) { return !one->is_mesh && one->handle == mesh->handle; });
  };
  std::vector<const DatasetTemplate*> kept;
  for (const DatasetTemplate* one : found) {
    const bool is_known = std::any_of(kept.begin(), kept.end(), [&](const DatasetTemplate* other) {
      return other->file == one->file && other->attributes == one->attributes;  // listed by two paths
    });
    if (!is_known && !(one->is_mesh && has_json(one))) kept.push_back(one);
  }
  return kept;
}

const DatasetTemplate* DatasetConfig::find_only(TemplateKind kind, const std::string& handle) const {
  const std::vector<const DatasetTemplate*> found = matches(kind, handle);
  return found.size() == 1 ? found.front() : nullptr;
}

const DatasetTemplate& DatasetConfig::find(TemplateKind kind, const std::string& handle, const JsonFields& fields, const char* key) const {
  const std::vector<const DatasetTemplate*> found = matches(kind, handle);
  if (found.size() == 1) return *found.front();
  const std::string shown = one_line(handle), name = kind_of(kind).name;
  if (found.size() > 1)
    fields.fail(key, fmt::format("'{}' is the {} '{}' and '{}'", shown, name, one_line(found[0]->handle), one_line(found[1]->handle)),
                "write the whole path");
  std::set<std::string> handles;
  for (const DatasetTemplate& one : all(kind)) handles.insert(last_components(one.handle, handle));
  const std::string nearest = nearest_word(handle, handles);
  fields.fail(key, fmt::format("names the {} '{}', which {} does not list", name, shown, path_.filename().string()),
              nearest.empty() ? fmt::format("see `{}` there", kind_of(kind).key) : fmt::format("is it '{}'?", one_line(nearest)));
}

Attributes DatasetConfig::attributes_of(TemplateKind kind, const DatasetTemplate& found, nlohmann::json& json) const {
  const std::string key = kind_of(kind).key;
  Attributes attributes;
  const nlohmann::json& section = json_->contains(key) ? (*json_)[key] : *json_;
  if (json_->contains(key) && section.contains("default_attributes"))
    attributes.add(JsonFields(section["default_attributes"], path_, key + ".default_attributes"));
  json = found.file.empty() || found.is_mesh ? nlohmann::json::object() : read_json_object(found.file);
  attributes.add(JsonFields(json, found.file.empty() ? path_ : found.file, ""));
  if (found.attributes) attributes.add(JsonFields(*found.attributes, path_, fmt::format("attributes of '{}'", found.handle)));
  return attributes;
}

std::optional<fs::path> DatasetConfig::descriptor(const std::string& handle, const JsonFields& fields, const char* key) const {
  const JsonFields top(*json_, path_, "");
  constexpr const char* section = "semantic_scene_descriptor_instances";
  const nlohmann::json* named = top.object(section);
  if (!named || named->contains("paths")) return std::nullopt;
  const JsonFields entries(*named, path_, section);
  const auto file = entries.text(handle.c_str());
  if (!file)
    fields.fail(key, fmt::format("'{}' is not among {} of {}", one_line(handle), section, path_.filename().string()), "add it there");
  return path_within(root_, root_, *file, entries, handle.c_str());
}

}  // namespace earshot
