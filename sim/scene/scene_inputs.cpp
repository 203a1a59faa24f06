// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_inputs.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <set>
#include <sstream>
#include <string_view>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/annotations/annotation_files.h"
#include "sim/scene/habitat/habitat_scene.h"
#include "sim/scene/mesh_spec.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/readers/obj_materials.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

/// An unreadable input makes the whole hash unavailable.
struct Unknown {};

bool is_generated(std::string_view spec) {
  return spec.starts_with("shoebox:") || spec.starts_with("house:") || spec.starts_with("floor:");
}

bool is_picture(const fs::path& path) {
  constexpr std::array<std::string_view, 9> pictures{".png", ".jpg", ".jpeg", ".webp", ".ktx2", ".dds", ".basis", ".tga", ".bmp"};
  return std::find(pictures.begin(), pictures.end(), fold_case(path.extension().string())) != pictures.end();
}

class InputHash {
 public:
  void add_text(std::string_view text) {
    const std::uint64_t size = text.size();
    hash_ = hash64(std::string_view(reinterpret_cast<const char*>(&size), sizeof size), hash_);
    hash_ = hash64(text, hash_);
  }
  /// The bytes, which are returned.
  std::string add_file(const fs::path& path) {
    std::string bytes = read_file(path);
    add_text(bytes);
    files_.insert(path.string());
    return bytes;
  }
  /// A file that may be absent.
  void add_existing(const fs::path& path) {
    std::error_code error;
    if (fs::is_regular_file(path, error)) {
      add_file(path);
    } else {
      add_text("absent");
    }
  }
  void add_reference(const fs::path& folder, const std::string& name) {
    if (name.find('\\') != std::string::npos || name.find('%') != std::string::npos) throw Unknown{};  // an escape: another name
    add_text(name);
    const fs::path path = folder / name;
    if (!is_picture(path)) return add_existing(path);
    std::error_code error;
    const auto size = fs::file_size(path, error);
    add_text(error ? "absent" : std::to_string(size));
    if (!error) files_.insert(path.string());
    const auto time = fs::last_write_time(path, error);
    add_text(error ? "absent" : std::to_string(time.time_since_epoch().count()));
  }
  [[nodiscard]] std::uint64_t value() const { return hash_; }
  [[nodiscard]] const std::set<std::string>& files() const { return files_; }

 private:
  std::uint64_t hash_ = 0;
  std::set<std::string> files_;
};

/// Every "uri": "NAME" of a glTF; data URIs are among its bytes already.
void add_uris(InputHash& hash, const fs::path& mesh, std::string_view text) {
  constexpr std::string_view key = "\"uri\"", blanks = " \t\r\n";
  for (std::size_t at = text.find(key); at != std::string_view::npos; at = text.find(key, at + 1)) {
    std::size_t begin = text.find_first_not_of(blanks, at + key.size());
    if (begin == std::string_view::npos || text[begin] != ':') continue;
    begin = text.find_first_not_of(blanks, begin + 1);
    if (begin == std::string_view::npos || text[begin] != '"') continue;
    if (text.substr(begin + 1).starts_with("data:")) continue;
    const std::size_t end = text.find('"', begin + 1);
    if (end == std::string_view::npos) return;
    hash.add_reference(mesh.parent_path(), std::string(text.substr(begin + 1, end - begin - 1)));
  }
}

/// Every material library that an OBJ names, and that of its own name, which counts where one is absent.
void add_material_libraries(InputHash& hash, const fs::path& mesh, std::string_view text) {
  const ObjLibraries libraries = find_obj_libraries(text, mesh);
  for (const std::vector<fs::path>* list : {&libraries.found, &libraries.missing})
    for (const fs::path& library : *list) hash.add_reference(mesh.parent_path(), library.lexically_relative(mesh.parent_path()).string());
  hash.add_existing(fs::path(mesh).replace_extension(".mtl"));
}

/// Pictures that material libraries among the files name.
std::set<std::string> pictures_of_libraries(const std::set<std::string>& files) {
  std::set<std::string> pictures;
  for (const fs::path path : files) {
    if (fold_case(path.extension().string()) != ".mtl") continue;
    std::istringstream lines(read_file(path));
    for (std::string line; std::getline(lines, line);) {
      if (line.find("map_") == std::string::npos) continue;
      const std::size_t end = line.find_last_not_of(" \t\r");
      const std::size_t begin = line.find_last_of(" \t", end);
      if (end == std::string::npos || begin == std::string::npos) continue;
      const fs::path picture = path.parent_path() / line.substr(begin + 1, end - begin);
      std::error_code error;
      if (is_picture(picture) && fs::is_regular_file(picture, error)) pictures.insert(picture.string());
    }
  }
  return pictures;
}

void add_mesh_file(InputHash& hash, const fs::path& mesh) {
  const std::string bytes = hash.add_file(mesh), extension = fold_case(mesh.extension().string());
  if (extension == ".gltf" || extension == ".glb") add_uris(hash, mesh, bytes);
  if (extension == ".obj") add_material_libraries(hash, mesh, bytes);
}

void add_annotated_mesh(InputHash& hash, const fs::path& mesh, const std::vector<AnnotationFiles>& pairs) {
  add_mesh_file(hash, mesh);
  for (const AnnotationFiles& files : pairs) {
    hash.add_existing(files.names);
    std::error_code error;
    if (files.carrier == mesh) continue;
    if (fs::is_regular_file(files.names, error) && fs::is_regular_file(files.carrier, error))
      add_mesh_file(hash, files.carrier);
    else
      hash.add_text("absent");
  }
}

void add_habitat_scene(InputHash& hash, const std::string& spec) {
  const HabitatScene scene = read_habitat_scene(spec);
  for (const fs::path& file : scene.files) hash.add_file(file);
  std::vector<AnnotationFiles> pairs = possible_annotations(scene.stage.mesh);
  if (scene.descriptor) pairs.push_back({*scene.descriptor, scene.semantic_mesh.value_or(scene.stage.mesh)});
  add_annotated_mesh(hash, scene.stage.mesh, pairs);
  std::set<fs::path> meshes;
  for (const PlacedAsset& object : scene.objects)
    if (meshes.insert(object.mesh).second) add_mesh_file(hash, object.mesh);
}

/// names: the file of annotations that the user names, or none.
void add_mesh(InputHash& hash, const std::string& spec, const std::optional<fs::path>& names = std::nullopt) {
  if (is_generated(spec)) return hash.add_text(spec);
  if (is_habitat_scene(spec)) return add_habitat_scene(hash, spec);
  const fs::path mesh(spec);
  if (!is_mesh_file(mesh)) throw Unknown{};
  std::vector<AnnotationFiles> pairs = possible_annotations(mesh);
  if (names) pairs = {{*names, carrier_beside(*names)}};
  add_annotated_mesh(hash, mesh, pairs);
}

void add_yaml(InputHash& hash, const fs::path& path) {
  hash.add_file(path);
  ConfigReader reader = ConfigReader::from_file(path);
  const auto beside = [&](const std::string& name) { return (path.parent_path() / name).lexically_normal(); };
  const std::string mesh = reader.scalar("mesh").value_or("");
  std::optional<fs::path> names;
  if (const auto annotations = reader.scalar("annotations")) names = beside(*annotations);
  add_mesh(hash, is_generated(mesh) ? mesh : beside(mesh).string(), names);
  if (const auto materials = reader.scalar("materials")) hash.add_file(beside(*materials));
  if (const auto semantics = reader.scalar("semantics"); semantics && *semantics != "indoor") hash.add_file(beside(*semantics));
}

std::optional<InputHash> inputs_of(const std::string& spec) {
  try {
    InputHash hash;
    hash.add_text(spec);  // random materials depend on it
    const std::string extension = fold_case(fs::path(spec).extension().string());
    if (!is_generated(spec) && !is_habitat_scene(spec) && (extension == ".yaml" || extension == ".yml"))
      add_yaml(hash, spec);
    else
      add_mesh(hash, is_generated(spec) || is_habitat_scene(spec) ? spec : parse_mesh_spec(spec).path);
    return hash;
  } catch (const Unknown&) {
    return std::nullopt;
  } catch (const InputError&) {
    return std::nullopt;  // load_scene meets the same, and throws it
  }
}

}  // namespace

std::optional<std::uint64_t> hash_of_scene_inputs(const std::string& spec) {
  const std::optional<InputHash> hash = inputs_of(spec);
  return hash ? std::optional(hash->value()) : std::nullopt;
}

std::optional<std::vector<std::string>> files_of_scene(const std::string& spec) {
  const std::optional<InputHash> hash = inputs_of(spec);
  if (!hash) return std::nullopt;
  std::set<std::string> files = hash->files();
  files.merge(pictures_of_libraries(files));
  return std::vector<std::string>(files.begin(), files.end());
}

}  // namespace earshot
