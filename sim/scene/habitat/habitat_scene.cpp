// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/habitat_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <memory>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/habitat/dataset_files.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_import.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kConfigEnd = ".scene_dataset_config.json", kSceneEnd = ".scene_instance.json", kSceneKey = ",scene=";
constexpr std::size_t kMaxNames = 4;  // in a message
constexpr double kLargestDirection = 1e6;
constexpr std::size_t kMaxFolders = 16;  // above a scene instance, in search of its config

// Keys that are read, and keys without an effect on geometry and categories.
const std::set<std::string_view> kSceneKeys{"stage_instance",
                                            "object_instances",
                                            "articulated_object_instances",
                                            "translation_origin",
                                            "semantic_scene_instance",
                                            "default_lighting",
                                            "navmesh_instance",
                                            "user_defined",
                                            "default_pbr_shader_config",
                                            "pbr_shader_region_configs"};
const std::set<std::string_view> kInstanceKeys{"template_name",      "translation", "rotation",    "uniform_scale", "non_uniform_scale",
                                               "translation_origin", "motion_type", "shader_type", "mass_scale",    "user_defined"};
const std::set<std::string_view> kAssetKeys{"render_asset",
                                            "semantic_asset",
                                            "semantic_descriptor_filename",
                                            "up",
                                            "front",
                                            "semantic_up",
                                            "semantic_front",
                                            "origin",
                                            "scale",
                                            "units_to_meters",
                                            "COM",
                                            "semantic_id",
                                            "collision_asset",
                                            "collision_asset_size",
                                            "nav_asset",
                                            "gravity",
                                            "margin",
                                            "friction_coefficient",
                                            "rolling_friction_coefficient",
                                            "spinning_friction_coefficient",
                                            "restitution_coefficient",
                                            "mass",
                                            "inertia",
                                            "is_collidable",
                                            "use_bounding_box_for_collision",
                                            "join_collision_meshes",
                                            "force_flat_shading",
                                            "shader_type",
                                            "requires_lighting",
                                            "user_defined"};

struct ConfigSpec {
  std::string path, handle;
};

/// Of a SCENE that names a config; an empty path for another one.
ConfigSpec parse_config_spec(std::string_view spec) {
  if (fold_case(spec).ends_with(kConfigEnd)) return {std::string(spec), ""};
  const std::size_t comma = spec.find(kSceneKey);
  if (comma == std::string_view::npos || !fold_case(spec.substr(0, comma)).ends_with(kConfigEnd)) return {};
  return {std::string(spec.substr(0, comma)), std::string(spec.substr(comma + kSceneKey.size()))};
}

std::string quoted_list(std::vector<std::string> names) {
  const std::size_t count = names.size();
  names.resize(std::min(count, kMaxNames));
  for (std::string& name : names) name = one_line(name);
  return listed(names, ", ") + (count > kMaxNames ? ", ..." : "");
}

/// A text with %% stands for a name that Habitat makes.
bool is_placeholder(const std::string& text) { return text.find("%%") != std::string::npos; }

class HabitatSceneReader {
 public:
  explicit HabitatSceneReader(std::shared_ptr<const DatasetConfig> config) : config_(std::move(config)) {
    scene_.files.push_back(config_->path());
  }

  HabitatScene take_stage(const DatasetTemplate& stage) {
    const nlohmann::json empty = nlohmann::json::object();
    const JsonFields none(empty, config_->path(), "");
    read_stage(stage, none);
    finish(none);
    return std::move(scene_);
  }

  HabitatScene take_scene(const DatasetTemplate& found) {
    nlohmann::json json;
    const Attributes attributes = config_->attributes_of(TemplateKind::scene, found, json);
    if (!found.file.empty()) scene_.files.push_back(found.file);
    attributes.add_unknown(kSceneKeys, unknown_);
    const JsonFields* stage_fields = attributes.with("stage_instance");
    if (!stage_fields) attributes.last().fail("stage_instance", "is missing", "name the stage of the scene");
    const JsonFields stage(*stage_fields->object("stage_instance"), stage_fields->file(), stage_fields->place_of("stage_instance"));
    stage.add_unknown(kInstanceKeys, unknown_);
    read_stage(config_->find(TemplateKind::stage, template_name(stage), stage, "template_name"), stage);
    const JsonFields* origin = attributes.with("translation_origin");
    const JsonFields& scene = origin ? *origin : attributes.last();
    if (const JsonFields* fields = attributes.with("object_instances")) {
      const nlohmann::json& list = *fields->list("object_instances");
      for (std::size_t i = 0; i < list.size(); ++i)
        read_object(JsonFields(list[i], fields->file(), fmt::format("{}[{}]", fields->place_of("object_instances"), i)), scene, i);
    }
    if (const JsonFields* fields = attributes.with("articulated_object_instances")) leave_out(*fields);
    if (const JsonFields* fields = attributes.with("semantic_scene_instance")) read_descriptor(*fields);
    finish(attributes.last());
    return std::move(scene_);
  }

 private:
  static std::string template_name(const JsonFields& instance) {
    const auto name = instance.text("template_name");
    if (!name || name->empty()) instance.fail("template_name", "is missing", "name a template of the data set");
    return *name;
  }

  /// The file that an attribute names; nullopt for none, an empty text and a placeholder.
  std::optional<fs::path> file_of(const Attributes& attributes, const char* key) {
    const JsonFields* fields = attributes.with(key);
    if (!fields) return std::nullopt;
    const std::string text = *fields->text(key);
    if (text.empty()) return std::nullopt;
    if (is_placeholder(text)) {
      has_placeholder_ = true;
      return std::nullopt;
    }
    const fs::path path = path_within(config_->root(), fields->file().parent_path(), text, *fields, key);
    std::error_code error;
    if (!fs::is_regular_file(path, error))
      fields->fail(key, fmt::format("names {}, which is not a file", path.string()), "copy the whole data set");
    return path;
  }

  fs::path mesh_of(const DatasetTemplate& found, const Attributes& attributes) {
    if (found.is_mesh && !attributes.with("render_asset")) return found.file;
    const auto mesh = file_of(attributes, "render_asset");
    if (!mesh) attributes.last().fail("render_asset", "is missing", "name the mesh of the template");
    if (!is_mesh_file(*mesh) || has_cloud_extension(*mesh))
      attributes.with("render_asset")
          ->fail("render_asset", fmt::format("names {}, which is not a mesh that is read", mesh->filename().string()),
                 "name a glb, gltf, obj, ply or stl file");
    return *mesh;
  }

  void read_stage(const DatasetTemplate& found, const JsonFields& instance) {
    nlohmann::json json;
    const Attributes attributes = config_->attributes_of(TemplateKind::stage, found, json);
    note_file(found);
    attributes.add_unknown(kAssetKeys, unknown_);
    scene_.stage.placement = place(frame_of(attributes), instance);
    scene_.stage.mesh = mesh_of(found, attributes);
    scene_.semantic_mesh = file_of(attributes, "semantic_asset");
    if (scene_.semantic_mesh && *scene_.semantic_mesh == scene_.stage.mesh) scene_.semantic_mesh.reset();
    scene_.descriptor = file_of(attributes, "semantic_descriptor_filename");
    check_semantic_axis(attributes, "semantic_up", "up", {0, 1, 0});
    check_semantic_axis(attributes, "semantic_front", "front", {0, 0, -1});
  }

  void check_semantic_axis(const Attributes& attributes, const char* semantic_key, const char* key, glm::dvec3 standard) const {
    const JsonFields *semantic = attributes.with(semantic_key), *render = attributes.with(key);
    if (!semantic || !scene_.semantic_mesh) return;
    if (*semantic->vector(semantic_key, kLargestDirection) != (render ? *render->vector(key, kLargestDirection) : standard))
      semantic->fail(semantic_key, fmt::format("is not `{}`: meshes in two frames are not read", key), "turn one of the meshes");
  }

  void note_file(const DatasetTemplate& found) {
    if (!found.file.empty() && !found.is_mesh && std::find(scene_.files.begin(), scene_.files.end(), found.file) == scene_.files.end())
      scene_.files.push_back(found.file);
  }

  /// What instances of one template have in common.
  struct ReadTemplate {
    std::shared_ptr<nlohmann::json> json = std::make_shared<nlohmann::json>();
    Attributes attributes;
    Placement frame;
    fs::path mesh;
    std::optional<std::int64_t> semantic_id;
  };

  const ReadTemplate& object_template(const DatasetTemplate& found) {
    const auto [place, is_new] = templates_.try_emplace(&found);
    ReadTemplate& read = place->second;
    if (!is_new) return read;
    read.attributes = config_->attributes_of(TemplateKind::object, found, *read.json);
    note_file(found);
    read.attributes.add_unknown(kAssetKeys, unknown_);
    read.frame = frame_of(read.attributes);
    read.mesh = mesh_of(found, read.attributes);
    if (const JsonFields* fields = read.attributes.with("semantic_id")) read.semantic_id = fields->whole("semantic_id");
    return read;
  }

  void read_object(const JsonFields& instance, const JsonFields& scene, std::size_t number) {
    instance.add_unknown(kInstanceKeys, unknown_);
    const DatasetTemplate& found = config_->find(TemplateKind::object, template_name(instance), instance, "template_name");
    const ReadTemplate& read = object_template(found);
    const std::string stem = fs::path(found.handle).filename().string();
    scene_.objects.push_back({.mesh = read.mesh,
                              .placement = place_by_mass(place(read.frame, instance), read.attributes, instance, scene),
                              .name = one_line(fmt::format("{}_{}", stem, number)),
                              .semantic_id = read.semantic_id});
  }

  void leave_out(const JsonFields& fields) {
    const nlohmann::json& list = *fields.list("articulated_object_instances");
    if (list.empty()) return;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < list.size(); ++i)
      names.push_back(template_name(JsonFields(list[i], fields.file(), fmt::format("articulated_object_instances[{}]", i))));
    scene_.warnings.push_back(
        fmt::format("{} articulated objects are left out, as their URDF is not read: {}", names.size(), quoted_list(names)));
  }

  void read_descriptor(const JsonFields& fields) {
    constexpr const char* key = "semantic_scene_instance";
    const std::string handle = *fields.text(key);
    if (handle.empty()) return;
    if (is_placeholder(handle)) {
      has_placeholder_ = true;
      return;
    }
    const auto file = config_->descriptor(handle, fields, key);
    const bool is_config = file && ends_with_folded(file->filename().string(), ".semantic_config.json");
    if (!file || is_config) {
      scene_.warnings.push_back(
          fmt::format("{} '{}' is not read: the layout of a .semantic_config.json has no public description", key, one_line(handle)));
      return;
    }
    std::error_code error;
    if (!fs::is_regular_file(*file, error))
      fields.fail(key, fmt::format("stands for {}, which is not a file", file->string()), "copy the whole data set");
    scene_.descriptor = file;
  }

  void finish(const JsonFields& where) {
    if (has_placeholder_)
      scene_.warnings.push_back(fmt::format("{}: names with %% have no public description; annotations are found by the name of the mesh",
                                            where.file().filename().string()));
    if (!unknown_.empty())
      scene_.warnings.push_back(fmt::format("{} unknown keys have no effect: {}", unknown_.size(),
                                            quoted_list(std::vector<std::string>(unknown_.begin(), unknown_.end()))));
  }

  std::shared_ptr<const DatasetConfig> config_;
  HabitatScene scene_;
  std::map<const DatasetTemplate*, ReadTemplate> templates_;
  std::set<std::string> unknown_;
  bool has_placeholder_ = false;
};

bool is_same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error) && !error;
}

const DatasetTemplate* listed_file(const DatasetConfig& config, const fs::path& file) {
  for (const DatasetTemplate& one : config.all(TemplateKind::scene))
    if (one.file.filename() == file.filename() && !one.attributes && is_same_file(one.file, file)) return &one;
  return nullptr;
}

/// A scene instance by its path, with the config that lists it.
HabitatScene read_by_instance(const fs::path& file) {
  static_cast<void>(read_json_object(file));  // before the search: it may be missing or damaged
  fs::path folder = file.parent_path();
  std::exception_ptr damaged;  // of the first config that cannot be read: another one may list the scene
  for (std::size_t level = 0; level < kMaxFolders; ++level) {
    std::vector<std::shared_ptr<const DatasetConfig>> configs;
    for (const fs::path& path : find_files(folder.empty() ? fs::path(".") : folder, std::string(kConfigEnd))) {
      try {
        auto config = std::make_shared<const DatasetConfig>(path);
        if (listed_file(*config, file)) configs.push_back(std::move(config));
      } catch (const InputError&) {
        if (!damaged) damaged = std::current_exception();
      }
    }
    if (configs.size() > 1)
      throw InputError(file.string(),
                       fmt::format("is listed by {} and {}", configs[0]->path().string(), configs[1]->path().filename().string()),
                       fmt::format("write {},scene={}", configs[0]->path().string(), listed_file(*configs[0], file)->handle));
    if (configs.size() == 1) return HabitatSceneReader(configs[0]).take_scene(*listed_file(*configs[0], file));
    std::error_code error;
    if (fs::equivalent(folder.empty() ? fs::path(".") : folder, "/", error)) break;
    folder = folder.empty() || folder.filename() == ".." || folder.filename() == "." ? folder / ".." : folder.parent_path();
  }
  if (damaged) std::rethrow_exception(damaged);
  throw InputError(file.string(), "is listed by no *.scene_dataset_config.json in its folder or those above",
                   "keep the data set together, or write CONFIG,scene=HANDLE");
}

HabitatScene read_by_config(const ConfigSpec& spec) {
  const auto config = std::make_shared<const DatasetConfig>(spec.path);
  HabitatSceneReader reader(config);
  if (!spec.handle.empty()) {
    if (const DatasetTemplate* scene = config->find_only(TemplateKind::scene, spec.handle)) return reader.take_scene(*scene);
    const nlohmann::json named{{"scene", spec.handle}};
    const JsonFields fields(named, spec.path, "");
    if (const DatasetTemplate* stage = config->find_only(TemplateKind::stage, spec.handle)) return reader.take_stage(*stage);
    return reader.take_scene(config->find(TemplateKind::scene, spec.handle, fields, "scene"));
  }
  const std::vector<DatasetTemplate>&scenes = config->all(TemplateKind::scene), &stages = config->all(TemplateKind::stage);
  if (scenes.size() == 1) return reader.take_scene(scenes.front());
  if (scenes.empty() && stages.size() == 1) return reader.take_stage(stages.front());
  const std::vector<DatasetTemplate>& choices = scenes.empty() ? stages : scenes;
  if (choices.empty()) throw InputError(spec.path, "lists no scene and no stage that is there", "copy the whole data set");
  std::vector<std::string> handles;
  for (const DatasetTemplate& one : choices) handles.push_back(one.handle);
  throw InputError(spec.path, fmt::format("lists {} scenes: {}", handles.size(), quoted_list(handles)),
                   fmt::format("write FILE,scene={}", one_line(handles.front())));
}

}  // namespace

bool is_habitat_scene(std::string_view spec) { return fold_case(spec).ends_with(kSceneEnd) || !parse_config_spec(spec).path.empty(); }

HabitatScene read_habitat_scene(const std::string& spec) {
  const ConfigSpec config = parse_config_spec(spec);
  return config.path.empty() ? read_by_instance(spec) : read_by_config(config);
}

std::map<std::int64_t, std::string> read_classes(const fs::path& descriptor) {
  std::map<std::int64_t, std::string> classes;
  if (fold_case(descriptor.extension().string()) != ".json") return classes;
  const nlohmann::json json = read_json_object(descriptor);
  const nlohmann::json* list = JsonFields(json, descriptor, "").list("classes");
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonFields entry((*list)[i], descriptor, fmt::format("classes[{}]", i));
    const auto id = entry.whole("id");
    const auto name = entry.text("name");
    if (!id) entry.fail("id", "is missing", "copy the file again");
    if (!name) entry.fail("name", "is missing", "copy the file again");
    if (!classes.try_emplace(*id, one_line(*name)).second) entry.fail("id", fmt::format("occurs twice: {}", *id), "remove one");
  }
  return classes;
}

}  // namespace earshot
