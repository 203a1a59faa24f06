#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace earshot {

/// A name of an OBJ or MTL ends at its line; a number sign with blanks around it begins a comment ("Brick #1" is a name).
std::string_view obj_name(std::string_view rest);

/// Diffuse colour (Kd) and its texture (map_Kd) of one material of an OBJ.
struct ObjLook {
  std::optional<glm::vec3> base_color;
  std::string texture;
};

/// By name, of the text of a material library (MTL).  What it does not understand it leaves out: looks are no geometry.
void parse_mtl(std::string_view text, std::map<std::string, ObjLook, std::less<>>& looks);

/// Of every library that the OBJ names (mtllib), beside it, and of the library of its own name where one of those is absent.
/// obj: the bytes of the file at `path`.  Throws InputError for a library that is there and cannot be read.
std::map<std::string, ObjLook, std::less<>> read_obj_looks(std::string_view obj, const std::filesystem::path& path);

}  // namespace earshot
