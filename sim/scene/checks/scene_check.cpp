// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/checks/scene_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "sim/base/text/listed.h"
#include "sim/scene/annotations/annotations.h"
#include "sim/scene/checks/axes_guess.h"

namespace earshot {
namespace {

constexpr double kMaxLeaked = 0.01, kMinVolumeM3 = 1;
/// Above this a scene is open country: over a floor alone one half of the rays leaves, of a wide room without a ceiling two fifths.
constexpr double kOpenCountry = 0.45;
constexpr std::size_t kMaxNames = 4;

void warn_of_air(const SceneReport& report, std::vector<std::string>& warnings) {
  if (report.ray_efficiency < kMaxLeaked)
    warnings.emplace_back(
        "the scene encloses no air: almost no ray that starts above its floor hits a surface; check that the mesh is complete and that its "
        "up axis is right");
  else if (report.leaked_ray_fraction > kOpenCountry)
    return;
  else if (report.leaked_ray_fraction > kMaxLeaked)
    warnings.push_back(
        fmt::format("{:.0f} % of the rays leave the scene through holes or a missing ceiling; `earshot scene` lists the holes",
                    100 * report.leaked_ray_fraction));
  else if (report.volume_m3 < kMinVolumeM3)
    warnings.push_back(fmt::format("the scene encloses {:.3g} m3 of air; check its unit, and that the mesh is complete", report.volume_m3));
}

/// Surfaces that nothing names a material for.
bool is_unnamed(const MaterialChoice& choice, bool has_semantics) {
  if (choice.reason == MaterialReason::fallback) return true;
  return has_semantics && choice.reason == MaterialReason::chosen_default && !choice.has_category;
}

/// Of annotated_import.h, which names the area without a category.
bool is_about_annotations(std::string_view warning) { return warning.find("has no category in") != std::string_view::npos; }

/// Also of one object (acoustic_randomization.h).
bool is_unlabelled(std::string_view slot) { return slot == kUnlabelled || slot.starts_with(std::string(kUnlabelled) + "/"); }

void warn_of_materials(const Scene& scene, std::vector<std::string>& warnings) {
  const ImportReport& report = scene.import_report();
  if (report.choices.size() != scene.materials().size()) return;
  const bool is_annotated = std::ranges::any_of(report.warnings, is_about_annotations);
  const std::vector<double> areas = slot_areas(scene);
  std::vector<std::string> names, materials;
  double area_m2 = 0, all_m2 = 0;
  for (std::size_t slot = 0; slot < areas.size(); ++slot) {
    all_m2 += areas[slot];
    if (!is_unnamed(report.choices[slot], report.has_semantics)) continue;
    if (is_annotated && is_unlabelled(scene.mesh().material_names[slot])) continue;
    area_m2 += areas[slot];
    names.push_back("'" + scene.mesh().material_names[slot] + "'");
    const std::string material = "'" + scene.materials()[slot].name + "'";
    if (std::ranges::find(materials, material) == materials.end()) materials.push_back(material);
  }
  if (names.empty()) return;
  const std::size_t count = names.size();
  if (count > kMaxNames) {
    names.resize(kMaxNames);
    names.emplace_back("...");
  }
  warnings.push_back(fmt::format("no {} for {} of {} surfaces ({:.0f} % of the area), which use {}: {} ({})",
                                 report.has_semantics ? "semantic category was found" : "material is assigned", count, areas.size(),
                                 all_m2 > 0 ? 100 * area_m2 / all_m2 : 0, listed(materials, ", "), listed(names, ", "),
                                 report.has_semantics ? "assign them in the scene YAML" : "assign materials in a scene YAML"));
}

bool is_about_unit(std::string_view warning) { return warning.find("is the unit right?") != std::string_view::npos; }

void warn_of_axes(const Scene& scene, const SceneReport& report, std::vector<std::string>& warnings) {
  const FileAxes& axes = *scene.import_report().axes;
  const AxesGuess guess = guess_axes(scene, report);
  if (guess.unit_m && !axes.is_unit_given && std::ranges::none_of(warnings, is_about_unit))
    warnings.push_back(
        fmt::format("the unit of the mesh is probably wrong: {} (--unit {}, or unit_m in a scene YAML)", guess.unit_why, *guess.unit_m));
  if (guess.up && !axes.is_up_given)
    warnings.push_back(
        fmt::format("the up axis of the mesh is probably {}: {} (--up {}, or up in a scene YAML)", *guess.up, guess.up_why, *guess.up));
}

}  // namespace

std::vector<std::string> scene_warnings(const Scene& scene) {
  if (!scene.import_report().axes) return scene.import_report().warnings;
  return scene_warnings(scene, report_scene(scene));
}

std::vector<std::string> scene_warnings(const Scene& scene, const SceneReport& report) {
  std::vector<std::string> warnings = scene.import_report().warnings;
  if (!scene.import_report().axes) return warnings;
  warn_of_axes(scene, report, warnings);
  warn_of_air(report, warnings);
  warn_of_materials(scene, warnings);
  return warnings;
}

std::string reason_of(const MaterialChoice& choice) {
  switch (choice.reason) {
    case MaterialReason::pattern:
      return "assign." + choice.by;
    case MaterialReason::category:
      return "category " + choice.by;
    case MaterialReason::own:
      return "of the generated scene";
    case MaterialReason::chosen_default:
      return "default_material";
    case MaterialReason::label:
      return "a name or label of the database";
    case MaterialReason::fallback:
      break;
  }
  return "default: no material is assigned";
}

std::vector<double> slot_areas(const Scene& scene) {
  std::vector<double> areas(scene.materials().size(), 0);
  const TriangleMesh& mesh = scene.mesh();
  for (std::uint32_t triangle = 0; triangle < mesh.triangles.size(); ++triangle)
    areas[mesh.triangle_material[triangle]] += static_cast<double>(scene.triangle_area_m2(triangle));
  return areas;
}

}  // namespace earshot
