// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/annotation_files.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/annotations/house_file.h"
#include "sim/scene/annotations/replica_info.h"
#include "sim/scene/annotations/semantic_text.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLargestAnnotations = std::size_t{256} << 20;

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string extension_of(const fs::path& path) { return fold_case(path.extension().string()); }

/// A name without this end, if it has it.
std::string without(std::string name, std::string_view end) {
  if (name.ends_with(end)) name.resize(name.size() - end.size());
  return name;
}

/// The name that all files of a scene begin with: X of X.basis.glb, X.semantic.glb, X_semantic.ply.
std::string scene_of(const fs::path& mesh) { return without(without(without(mesh.stem().string(), ".basis"), ".semantic"), "_semantic"); }

fs::path beside(const fs::path& mesh, const std::string& name) { return mesh.parent_path() / name; }

bool is_gltf(const fs::path& mesh) { return extension_of(mesh) == ".glb" || extension_of(mesh) == ".gltf"; }

}  // namespace

std::vector<AnnotationFiles> possible_annotations(const fs::path& mesh) {
  const std::string scene = scene_of(mesh), stem = mesh.stem().string();
  if (is_gltf(mesh)) {
    const fs::path text = beside(mesh, scene + ".semantic.txt");
    return {{text, stem.ends_with(".semantic") ? mesh : beside(mesh, scene + ".semantic.glb")},
            {beside(mesh, scene + ".house"), beside(mesh, scene + "_semantic.ply")}};
  }
  if (extension_of(mesh) != ".ply") return {};
  std::vector<AnnotationFiles> pairs{{beside(mesh, scene + ".house"), mesh}, {beside(mesh, "info_semantic.json"), mesh}};
  if (stem == "mesh") pairs.push_back({beside(mesh, "habitat") / "info_semantic.json", beside(mesh, "habitat") / "mesh_semantic.ply"});
  return pairs;
}

std::vector<AnnotationFiles> present_annotations(const fs::path& mesh) {
  std::vector<AnnotationFiles> pairs = possible_annotations(mesh);
  std::erase_if(pairs, [](const AnnotationFiles& files) { return !is_file(files.names) || !is_file(files.carrier); });
  return pairs;
}

fs::path carrier_beside(const fs::path& names) {
  const std::string extension = extension_of(names), scene = scene_of(names);
  if (extension == ".json") return beside(names, "mesh_semantic.ply");
  return beside(names, scene + (extension == ".house" ? "_semantic.ply" : ".semantic.glb"));
}

std::vector<std::string> unread_annotations(const fs::path& mesh) {
  if (const fs::path scn = beside(mesh, scene_of(mesh) + ".scn"); is_file(scn))
    return {fmt::format("{} is not read: the format of Gibson's annotations has no public description", scn.string())};
  std::vector<std::string> lines;
  if (!is_gltf(mesh)) return lines;
  for (const AnnotationFiles& files : possible_annotations(mesh)) {
    const bool has_names = is_file(files.names);
    if (has_names == is_file(files.carrier)) continue;
    lines.push_back(fmt::format("{} is not there, so no surface has a category from {}", (has_names ? files.carrier : files.names).string(),
                                (has_names ? files.names : files.carrier).filename().string()));
  }
  return lines;
}

Annotations read_annotations(const fs::path& path) {
  const std::string extension = extension_of(path), where = path.string();
  if (extension != ".house" && extension != ".json" && extension != ".txt")
    throw InputError(where, "is not a file of annotations that is read",
                     "give a .house (Matterport3D), an info_semantic.json (Replica) or a .semantic.txt (HM3D)");
  const std::string bytes = read_file(path, kLargestAnnotations);
  std::string_view text = bytes;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  if (extension == ".house") return parse_house_file(text, where);
  return extension == ".json" ? parse_replica_info(text, where) : parse_semantic_text(text, where);
}

}  // namespace earshot
