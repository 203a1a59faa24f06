// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/mesh_file.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/readers/face_count.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/obj_materials.h"
#include "sim/scene/readers/obj_reader.h"
#include "sim/scene/readers/ply_reader.h"
#include "sim/scene/readers/stl_reader.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxNames = 4;  // in a warning

void add_obj_looks(std::string_view bytes, const std::filesystem::path& path, MeshFile& file) {
  const auto looks = read_obj_looks(bytes, path);
  for (MeshPart& part : file.parts) {
    const auto found = looks.find(part.material);
    if (found == looks.end()) continue;
    if (found->second.base_color) part.base_color = {*found->second.base_color};
    part.texture = found->second.texture;
  }
}

void warn_of_missing_libraries(std::string_view bytes, const std::filesystem::path& path, MeshFile& file) {
  std::vector<std::string> names;
  for (const std::filesystem::path& library : find_obj_libraries(bytes, path).missing)
    names.push_back(one_line(library.filename().string()));
  if (names.empty()) return;
  const std::size_t count = names.size();
  names.resize(std::min(count, kMaxNames));
  file.warnings.push_back(
      fmt::format("{} material libraries are missing ({}{}), so surfaces have no colors and textures; material names are still used", count,
                  listed(names, ", "), count > kMaxNames ? ", ..." : ""));
}

}  // namespace

MeshFile read_mesh_file(const std::filesystem::path& path, bool with_looks) {
  const std::string where = path.string(), extension = fold_case(path.extension().string()), stem = path.stem().string();
  const std::string whole = read_file(path);
  std::string_view bytes = whole;
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  MeshFile file;
  std::uint64_t num_faces = 0;
  if (extension == ".obj") {
    file = parse_obj(bytes, where, {.with_looks = with_looks});
    num_faces = count_obj_faces(bytes);
    if (with_looks)
      add_obj_looks(bytes, path, file);
    else
      warn_of_missing_libraries(bytes, path, file);
  } else if (extension == ".ply") {
    file = parse_ply(bytes, where, stem, with_looks);
    num_faces = count_ply_faces(bytes);
  } else {
    file = parse_stl(bytes, where, stem, with_looks);
    num_faces = count_stl_faces(bytes);
  }
  if (file.num_faces != num_faces)
    throw InputError(where, fmt::format("contains {} faces, but only {} could be read", num_faces, file.num_faces),
                     "export it again, or as glTF");
  return file;
}

}  // namespace earshot
