// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh_spec.h"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "sim/base/errors.h"

namespace earshot {
namespace {

void take_choice(MeshSpec& mesh, std::string_view text, const std::string& spec) {
  const std::size_t equals = text.find('=');
  const std::string_view key = text.substr(0, equals), value = equals == std::string_view::npos ? "" : text.substr(equals + 1);
  if (key == "unit" && !mesh.unit_m) {
    double unit_m = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), unit_m);
    if (error != std::errc() || end != value.data() + value.size() || !(unit_m >= 1e-6 && unit_m <= 1e6))
      throw InputError(spec, fmt::format("has the unit '{}'", value), "write metres per unit of the file, in [1e-6, 1e6]");
    mesh.unit_m = unit_m;
  } else if (key == "up" && !mesh.up) {
    if (value != "y" && value != "z") throw InputError(spec, fmt::format("has the up axis '{}'", value), "write up=y or up=z");
    mesh.up = value == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
  } else {
    throw InputError(spec, fmt::format("has '{}' after the file", text), "write FILE,unit=METRES or FILE,up=y or FILE,up=z, each once");
  }
}

bool is_there(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

}  // namespace

MeshSpec parse_mesh_spec(const std::string& spec) {
  for (std::size_t comma = spec.find(','); comma != std::string::npos; comma = spec.find(',', comma + 1)) {
    MeshSpec mesh{.path = spec.substr(0, comma), .unit_m = {}, .up = {}};
    if (!is_mesh_file(mesh.path)) continue;
    if (is_there(spec)) break;
    std::string_view rest = std::string_view(spec).substr(comma + 1);
    while (true) {
      const std::size_t end = rest.find(',');
      take_choice(mesh, rest.substr(0, end), spec);
      if (end == std::string_view::npos) return mesh;
      rest.remove_prefix(end + 1);
    }
  }
  return {.path = spec, .unit_m = {}, .up = {}};
}

std::string add_mesh_choices(const std::string& spec, std::optional<double> unit_m, std::optional<MeshImportOptions::Up> up) {
  if (!unit_m && !up) return spec;
  const MeshSpec mesh = parse_mesh_spec(spec);
  if (!is_mesh_file(mesh.path)) throw InputError(spec, "is not a mesh file, but --unit or --up was given", "leave them out");
  if ((mesh.unit_m && unit_m) || (mesh.up && up))
    throw InputError(spec, "already names a unit or an up axis, but --unit or --up was given", "give it once");
  std::string all = spec;
  if (unit_m) all += fmt::format(",unit={}", *unit_m);
  if (up) all += *up == MeshImportOptions::Up::z ? ",up=z" : ",up=y";
  parse_mesh_spec(all);  // checks the unit
  return all;
}

}  // namespace earshot
