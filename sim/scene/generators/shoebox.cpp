// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/shoebox.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <optional>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 6> wall_names{"x0", "x1", "y0", "y1", "z0", "z1"};

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (;;) {
    const std::size_t end = text.find(separator);
    parts.push_back(text.substr(0, end));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

std::optional<float> parse_number(std::string_view text) {
  float value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

Material wall_material(std::string_view text, const MaterialDatabase& database, const std::string& where) {
  const std::optional<float> absorption = parse_number(text);
  if (!absorption) return database.get(text, where);
  if (!(*absorption >= 0 && *absorption <= 1)) {
    throw InputError(where, fmt::format("absorption {} is outside [0, 1]", *absorption), "absorption is a fraction of the energy");
  }
  Material material = Material::uniform("absorption " + std::string(text), *absorption, 0);
  if (const Material* fallback = database.find_label("default")) material.scattering = fallback->scattering;
  return material;
}

}  // namespace

TriangleMesh make_shoebox(glm::vec3 size_m) {
  TriangleMesh mesh;
  append_box(mesh, glm::vec3(0), size_m, 0, 0);
  mesh.material_names.assign(wall_names.begin(), wall_names.end());
  mesh.object_names = {"wall_0", "wall_1", "floor_0", "ceiling_0", "wall_2", "wall_3"};
  for (std::uint32_t t = 0; t < 12; ++t) {  // append_box has two triangles per face, in the order of the slots
    std::swap(mesh.triangles[t].y, mesh.triangles[t].z);
    mesh.triangle_material[t] = mesh.triangle_object[t] = t / 2;
  }
  return mesh;
}

Shoebox parse_shoebox(std::string_view text, const MaterialDatabase& database) {
  const std::string where = "shoebox:" + std::string(text);
  const std::string_view size_text = text.substr(0, text.find('@'));
  const std::vector<std::string_view> parts = split(size_text, 'x');
  if (parts.size() != 3)
    throw InputError(where, "does not have three sizes", "write shoebox:XxYxZ in metres, for example shoebox:6x3x4@0.1");
  glm::vec3 size_m;
  for (int axis = 0; axis < 3; ++axis) {
    const std::optional<float> size = parse_number(parts[static_cast<std::size_t>(axis)]);
    if (!size || !(*size >= 1e-3f && *size <= 1e6f)) {
      throw InputError(where, fmt::format("size '{}' is not a number in [0.001, 1000000]", parts[static_cast<std::size_t>(axis)]),
                       "write shoebox:XxYxZ in metres, for example shoebox:6x3x4@0.1");
    }
    size_m[axis] = *size;
  }
  Shoebox box{make_shoebox(size_m), {}};
  if (size_text.size() == text.size()) {
    const Material* fallback = database.find_label("default");
    if (!fallback) throw InputError(where, "the material database has no material labelled 'default'", "give a material after @");
    box.material_of_slot.assign(6, *fallback);
    return box;
  }
  const std::vector<std::string_view> walls = split(text.substr(size_text.size() + 1), ',');
  if (walls.size() != 1 && walls.size() != 6) {
    throw InputError(where, fmt::format("has {} materials after @", walls.size()),
                     "write one material, or six in the order x0,x1,y0,y1,z0,z1");
  }
  for (std::size_t wall = 0; wall < 6; ++wall) {
    box.material_of_slot.push_back(wall_material(walls[walls.size() == 1 ? 0 : wall], database, where));
  }
  return box;
}

}  // namespace earshot
