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

/// nullopt for what is not a number in [lower, upper].
std::optional<double> number_within(std::string_view text, double lower, double upper) {
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || !(number >= lower && number <= upper)) return std::nullopt;
  return number;
}

void take_choice(MeshSpec& mesh, std::string_view text, const std::string& spec) {
  const std::size_t equals = text.find('=');
  const std::string_view key = text.substr(0, equals), value = equals == std::string_view::npos ? "" : text.substr(equals + 1);
  if (key == "unit" && !mesh.unit_m) {
    mesh.unit_m = number_within(value, 1e-6, 1e6);
    if (!mesh.unit_m) throw InputError(spec, fmt::format("has the unit '{}'", value), "write metres per unit of the file, in [1e-6, 1e6]");
  } else if (key == "cell" && !mesh.cell_m) {
    mesh.cell_m = number_within(value, kMinCellM, kMaxCellM);
    if (!mesh.cell_m)
      throw InputError(spec, fmt::format("has the cell '{}'", value),
                       fmt::format("write the edge of a voxel in metres, in [{:g}, {:g}]", kMinCellM, kMaxCellM));
  } else if (key == "up" && !mesh.up) {
    if (value != "y" && value != "z") throw InputError(spec, fmt::format("has the up axis '{}'", value), "write up=y or up=z");
    mesh.up = value == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
  } else {
    throw InputError(spec, fmt::format("has '{}' after the file", text),
                     "write FILE,unit=METRES or FILE,up=y or FILE,up=z or FILE,cell=METRES, each once");
  }
}

bool is_there(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

}  // namespace

MeshSpec parse_mesh_spec(const std::string& spec) {
  for (std::size_t comma = spec.find(','); comma != std::string::npos; comma = spec.find(',', comma + 1)) {
    MeshSpec mesh{.path = spec.substr(0, comma)};
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
  return {.path = spec};
}

std::string add_mesh_choices(const std::string& spec, const MeshChoices& choices) {
  if (choices.is_empty()) return spec;
  const MeshSpec mesh = parse_mesh_spec(spec);
  if (!is_mesh_file(mesh.path)) throw InputError(spec, "is not a mesh file, but --unit, --up or --cell was given", "leave them out");
  if ((mesh.unit_m && choices.unit_m) || (mesh.up && choices.up) || (mesh.cell_m && choices.cell_m))
    throw InputError(spec, "already names a unit, an up axis or a cell, but --unit, --up or --cell was given", "give it once");
  std::string all = spec;
  if (choices.unit_m) all += fmt::format(",unit={}", *choices.unit_m);
  if (choices.up) all += *choices.up == MeshImportOptions::Up::z ? ",up=z" : ",up=y";
  if (choices.cell_m) all += fmt::format(",cell={}", *choices.cell_m);
  parse_mesh_spec(all);  // checks the numbers
  return all;
}

}  // namespace earshot
