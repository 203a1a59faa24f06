// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// A name of an OBJ or MTL ends at its line; a number sign with blanks around it begins a comment ("Brick #1" is a name).
std::string_view obj_name(std::string_view rest);

/// Diffuse colour (Kd) and its texture (map_Kd) of one material of an OBJ.
struct ObjLook {
  std::optional<glm::vec3> base_color;
  std::string texture;
};

/// By name, of the text of a material library (MTL).  Ignores unknown statements, because appearance does not affect geometry.
void parse_mtl(std::string_view text, std::map<std::string, ObjLook, std::less<>>& looks);

/// The material libraries (mtllib) of an OBJ, each once.
struct ObjLibraries {
  std::vector<std::filesystem::path> found;    ///< in the order of the file
  std::vector<std::filesystem::path> missing;  ///< that it names and that are not there
};

/// The libraries that the OBJ names, beside it: a line is one name, or several where no file has the whole of it as its name.  Where one
/// is absent, the library of the OBJ's own name counts.  obj: the bytes of the file at `path`.
ObjLibraries find_obj_libraries(std::string_view obj, const std::filesystem::path& path);

/// Of all libraries that are found.  Throws InputError for one that cannot be read.
std::map<std::string, ObjLook, std::less<>> read_obj_looks(std::string_view obj, const std::filesystem::path& path);

}  // namespace earshot
