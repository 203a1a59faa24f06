// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/grid_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "envs/episodes/episode_generator.h"
#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/nav/walk_grid.h"

namespace earshot {
namespace {

/// Free air above the ears, for the head.
constexpr double kAboveEarsM = 0.1;

bool is_name_character(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '.' || c == '-' || c == '_';
}

void validate_name(const std::string& option, const std::string& name) {
  if (name.empty() || name.front() == '.' || name.size() > 200 || !std::ranges::all_of(name, is_name_character))
    throw InputError(option + " " + name, "is no name of a folder", "use up to 200 letters, digits, '.', '-' and '_', the first no '.'");
  const std::string ending = fold_case(std::filesystem::path(name).extension().string());
  if (ending == ".zarr" || ending == ".pkl")
    throw InputError(option + " " + name, "ends as the name of a file of a grid", "use a name without " + ending);
}

/// To the micrometre, and no -0.
double to_micrometre(double metres) { return std::round(1e6 * metres) / 1e6 + 0.0; }

}  // namespace

GridDataset GridDataset::named(std::string_view name) {
  if (name == "replica") return {.ear_height_m = 1.5528907, .spacing_m = 0.5, .sample_rate_hz = 44100};
  return {};
}

GridNames GridNames::of(const std::string& scene_spec) {
  const std::string text = scene_spec.substr(0, scene_spec.find(','));
  const std::filesystem::path path = text;
  std::vector<std::string> parts;
  for (const auto& part : path) parts.push_back(part.string());
  for (std::size_t i = 0; i + 3 < parts.size(); ++i)
    if (parts[i] == "scene_datasets") return {.dataset = parts[i + 1], .scene = parts[i + 2]};
  std::string name = std::filesystem::exists(path) ? path.stem().string() : text;
  for (char& c : name)
    if (!is_name_character(c)) c = '_';
  const bool is_among_sets = std::ranges::find(parts, "scene_datasets") != parts.end();
  return {.dataset = "mp3d",
          .scene = name,
          .warning = is_among_sets ? text +
                                         " has no folder of the scene as in scene_datasets/DATASET/SCENE/FILE, so DATASET is mp3d; "
                                         "--dataset sets another"
                                   : std::string()};
}

void validate(const GridNames& names) {
  validate_name("--dataset", names.dataset);
  validate_name("--name", names.scene);
}

GridPoints find_grid_points(const Scene& scene, const Navmesh& navmesh, double spacing_m, double ear_height_m) {
  require(spacing_m >= kLeastGridSpacingM && spacing_m <= kLargestGridSpacingM, "--spacing", spacing_m,
          fmt::format("must be in [{}, {}]", kLeastGridSpacingM, kLargestGridSpacingM));
  GridPoints found;
  found.walkable_m2 = static_cast<double>(navmesh.main_area_m2());
  const auto refuse_count = [&](double count) {
    throw InputError("--spacing " + fmt::format("{}", spacing_m),
                     fmt::format("gives about {:.0f} points in {}, more than {}", count, scene.name(), kMaxGridPoints),
                     "use a larger spacing");
  };
  if (const double expected = found.walkable_m2 / (spacing_m * spacing_m); expected > 2.0 * kMaxGridPoints) refuse_count(expected);
  const auto top_m = static_cast<float>(ear_height_m + kAboveEarsM);
  const glm::dvec3 origin = scene.to_local(glm::dvec3(0));
  const WalkGrid grid = make_walk_grid(navmesh, {.spacing_m = spacing_m, .anchor_m = {origin.x, origin.z}},
                                       [&](glm::vec3 foot) { return stands_free(scene, foot, top_m); });
  if (grid.points.size() > kMaxGridPoints) refuse_count(static_cast<double>(grid.points.size()));
  if (grid.points.size() < 2)
    throw InputError("--spacing " + fmt::format("{}", spacing_m),
                     fmt::format("gives {} point{} on {:.1f} m2 of walkable floor in {}", grid.points.size(),
                                 grid.points.size() == 1 ? "" : "s", found.walkable_m2, scene.name()),
                     "use a smaller spacing, or another scene");
  found.edges = grid.edges.size();
  found.left_out = grid.left_out;
  for (std::size_t i = 0; i < grid.points.size(); ++i) {
    const glm::dvec3 foot = scene.to_world(grid.points[i]);
    const glm::dvec3 ears(to_micrometre(foot.x), to_micrometre(foot.y + ear_height_m), to_micrometre(foot.z));
    found.points_text += fmt::format("{}\t{:.6f}\t{:.6f}\t{:.6f}\n", i, ears.x, to_micrometre(-ears.z), ears.y);
    found.ears.push_back(scene.to_local(ears));
    found.feet.push_back(scene.to_local(ears - glm::dvec3(0, ear_height_m, 0)));
  }
  for (const auto& [a, b] : grid.edges) found.edges_text += fmt::format("{}\t{}\n", a, b);
  return found;
}

}  // namespace earshot
