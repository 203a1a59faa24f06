// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/checks/axes_guess.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <glm/geometric.hpp>
#include <string_view>
#include <vector>

namespace earshot {
namespace {

constexpr double kLongestFreePathM = 40, kRoomFreePathM = 2.8, kGreatestHeightM = 150, kRoomHeightM = 3;
constexpr double kClearFraction = 0.8;

struct FileUnit {
  double unit_m;
  const char* name;
};
constexpr std::array<FileUnit, 4> kUnits{{{0.001, "millimetres"}, {0.01, "centimetres"}, {0.0254, "inches"}, {0.3048, "feet"}}};

/// Whether one of the words of a name is that of a thing that lies level.
bool is_called_level(std::string_view name) {
  static constexpr std::array<std::string_view, 9> words{"floor", "floors",   "ceiling", "ceilings", "ground",
                                                         "rug",   "flooring", "carpet",  "pavement"};
  std::string word;
  for (std::size_t i = 0; i <= name.size(); ++i) {
    const auto letter = i < name.size() ? static_cast<unsigned char>(name[i]) : static_cast<unsigned char>(' ');
    if (std::isalpha(letter)) {
      word += static_cast<char>(std::tolower(letter));
      continue;
    }
    if (std::ranges::find(words, word) != words.end()) return true;
    word.clear();
  }
  return false;
}

/// Area across each axis of the surfaces that are called level.
glm::dvec3 level_area(const Scene& scene) {
  const TriangleMesh& mesh = scene.mesh();
  std::vector<bool> level_material, level_object;
  for (const std::string& name : mesh.material_names) level_material.push_back(is_called_level(name));
  for (const std::string& name : mesh.object_names) level_object.push_back(is_called_level(name));
  glm::dvec3 area(0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!level_material[mesh.triangle_material[t]] && !level_object[mesh.triangle_object[t]]) continue;
    const glm::uvec3 corner = mesh.triangles[t];
    const glm::dvec3 a = mesh.vertices[corner.x], b = mesh.vertices[corner.y], c = mesh.vertices[corner.z];
    area += 0.5 * glm::abs(glm::cross(b - a, c - a));
  }
  return area;
}

void guess_unit(const Scene& scene, const SceneReport& report, const FileAxes& axes, AxesGuess& guess) {
  const double height_m = static_cast<double>(scene.bounds().upper.y - scene.bounds().lower.y);
  const bool is_closed = std::isfinite(report.area_m2) && report.area_m2 > 0;
  const double length_m = is_closed ? 4 * report.volume_m3 / report.area_m2 : height_m;
  const char* measure = is_closed ? "of mean free path" : "of height";
  guess.unit_why = fmt::format("{:.3g} m {}", length_m, measure);
  if (!(length_m > (is_closed ? kLongestFreePathM : kGreatestHeightM))) return;
  const double usual_m = is_closed ? kRoomFreePathM : kRoomHeightM;
  const auto distance = [&](const FileUnit& unit) { return std::fabs(std::log(length_m / axes.unit_m * unit.unit_m / usual_m)); };
  const FileUnit& best = *std::ranges::min_element(kUnits, {}, distance);
  if (best.unit_m == axes.unit_m) return;
  guess.unit_m = best.unit_m;
  guess.unit_why = fmt::format("{:.3g} m {} is not plausible for a room; in {} it is {:.3g} m", length_m, measure, best.name,
                               length_m / axes.unit_m * best.unit_m);
}

void guess_up(const Scene& scene, const FileAxes& axes, AxesGuess& guess) {
  const glm::dvec3 size = glm::dvec3(scene.bounds().upper) - glm::dvec3(scene.bounds().lower);
  const char other = axes.up == 'y' ? 'z' : 'y';
  guess.up_why = fmt::format("{:.3g} m high, or {:.3g} m with {} up", size.y, size.z, other);
  const glm::dvec3 level = level_area(scene);
  const double all = level.x + level.y + level.z;
  if (all > 0) {
    if (level.y > kClearFraction * all) guess.up_why = "surfaces named floor or ceiling are horizontal";
    if (level.z > kClearFraction * all) {
      guess.up = other;
      guess.up_why = "surfaces named floor or ceiling are vertical";
    }
    return;
  }
  constexpr double lowest_room_m = 1.8, highest_room_m = 6, slab = 2;
  if (size.z < lowest_room_m || size.z > highest_room_m || size.y < slab * size.z || size.x < slab * size.z) return;
  guess.up = other;
  guess.up_why = fmt::format("the scene is {:.3g} m high but only {:.3g} m deep", size.y, size.z);
}

}  // namespace

AxesGuess guess_axes(const Scene& scene, const SceneReport& report) {
  AxesGuess guess;
  const FileAxes axes = scene.import_report().axes.value_or(FileAxes{});
  guess_unit(scene, report, axes, guess);
  guess_up(scene, axes, guess);
  return guess;
}

}  // namespace earshot
