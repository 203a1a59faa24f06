// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/scene_options.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/model/air_absorption.h"
#include "sim/acoustics/model/effect_plan.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"
#include "sim/base/text/listed.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/checks/axes_guess.h"
#include "sim/scene/checks/scene_check.h"
#include "sim/scene/hole_finder.h"
#include "sim/scene/scene_report.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

struct SceneArguments {
  SceneOptions scene;
  std::string json, preset = "fast";
  std::vector<std::string> settings;
  bool explain = false;
};

constexpr double kMaxTightLeak = 0.001;

AcousticScene acoustics_of(const std::shared_ptr<const Scene>& scene, const SceneArguments& options) {
  AcousticConfig config = acoustic_preset(options.preset);
  ConfigReader reader = ConfigReader::from_text("", "--set", options.settings);
  read(reader, config);
  reader.finish();
  return {scene, config};
}

std::string shown_change(const EffectDecision& decision) {
  return std::isnan(decision.change) ? "-" : fmt::format("{}{:.3g} {}", decision.on ? "" : "<= ", decision.change, decision.unit);
}

/// The columns "leaving it out": for what is off the most that it may change a response, for what is on about what it contributes.
void print_plan(const EffectPlan& plan) {
  std::size_t widest = 0;
  for (const EffectDecision& decision : plan.decisions) widest = std::max(widest, decision.decision.size());
  fmt::print("effects          budget per effect: {} dB in every band down to -45 dB, {:.0f} % of RT60\n", kEffectBudgetDb,
             100 * kEffectBudgetRt);
  fmt::print("  {:<18} {:<{}} {:<15} {:<8} {:<11} {}\n", "effect", "decision", widest, "leaving it out", "bound", "saves/pose", "why");
  for (const EffectDecision& decision : plan.decisions) {
    fmt::print("  {:<18} {:<{}} {:<15} {:<8} {:<11} {}\n", decision.effect, decision.decision, widest, shown_change(decision),
               name_of(decision.kind), decision.saved_ms > 0 ? fmt::format("{:.4f} ms", decision.saved_ms) : "-", decision.why);
  }
}

Json plan_json(const EffectPlan& plan) {
  Json json = Json::object();
  for (const EffectDecision& decision : plan.decisions) {
    json[decision.effect] = {{"decision", decision.decision},
                             {"on", decision.on},
                             {"change", std::isfinite(decision.change) ? Json(decision.change) : Json(nullptr)},
                             {"unit", decision.unit},
                             {"bound", name_of(decision.kind)},
                             {"saved_ms", decision.saved_ms},
                             {"why", decision.why}};
  }
  return json;
}

Json numbers(const std::vector<double>& values) {
  Json array = Json::array();
  for (const double value : values) array.push_back(std::isfinite(value) ? Json(value) : Json(nullptr));
  return array;
}

/// A scene and what was measured of it.
struct ExaminedScene {
  std::shared_ptr<const Scene> scene;
  SceneReport report;
  std::vector<Hole> holes;
  std::vector<std::string> warnings;
  AxesGuess axes;
  std::optional<float> navigable_m2;
  std::string navigation_problem;  ///< why no floor is navigable
};

ExaminedScene examine(const SceneArguments& options) {
  ExaminedScene examined;
  examined.scene = std::make_shared<const Scene>(load_scene(options.scene.scene, options.scene.overrides()));
  const Scene& scene = *examined.scene;
  std::array<double, report_bands_hz.size()> air_per_m;
  for (std::size_t band = 0; band < air_per_m.size(); ++band)
    air_per_m[band] = air_absorption_energy_per_m(scene.air(), report_bands_hz[band]);
  examined.report = report_scene(scene, 0, air_per_m);
  examined.warnings = scene_warnings(scene, examined.report);
  examined.axes = guess_axes(scene, examined.report);
  if (examined.report.leaked_ray_fraction > kMaxTightLeak) examined.holes = find_holes(scene);
  try {
    examined.navigable_m2 = Navmesh(scene.mesh(), {}).main_area_m2();
  } catch (const InputError& error) {
    examined.navigation_problem = error.what();
  }
  return examined;
}

/// The unit and the up axis of a mesh file, whence, and what the mesh says of them.
void print_axes(const ExaminedScene& examined) {
  const std::optional<FileAxes>& axes = examined.scene->import_report().axes;
  if (!axes) return;
  const AxesGuess& guess = examined.axes;
  const auto given = [](bool is_given) { return is_given ? "given" : "default"; };
  fmt::print("unit             {:g} m ({}); {}{}\n", axes->unit_m, given(axes->is_unit_given),
             guess.unit_m ? fmt::format("probably {:g} m: ", *guess.unit_m) : "", guess.unit_why);
  fmt::print("up axis          {} ({}); {}{}\n", axes->up, given(axes->is_up_given),
             guess.up ? fmt::format("probably {}: ", *guess.up) : "", guess.up_why);
}

/// How points became a surface.
void print_cloud(const ExaminedScene& examined) {
  const std::optional<CloudReport>& cloud = examined.scene->import_report().cloud;
  if (!cloud) return;
  fmt::print("point cloud      {} points ({} invalid and {} stray left out), cell {:g} m ({})\n", cloud->points, cloud->invalid_points,
             cloud->stray_points, cloud->cell_m,
             cloud->is_cell_given ? "given" : fmt::format("default, median spacing {:.2g} m", cloud->spacing_m));
  fmt::print("closed holes     {}, {:.2f} m2, {:.2f} m wide at most; {:.1f} m3 of air enclosed, {:.1f} m3 unseen behind surfaces\n",
             cloud->holes, cloud->hole_area_m2, cloud->closed_width_m, cloud->air_m3, cloud->unseen_m3);
}

void print_mesh(const ExaminedScene& examined) {
  const Scene& scene = *examined.scene;
  const SceneReport& report = examined.report;
  const Bounds& b = scene.bounds();
  fmt::print("scene            {}\n", scene.name());
  fmt::print("triangles        {} ({} degenerate and {} duplicate removed, {} vertices welded)\n", report.triangles,
             report.removed.degenerate_removed, report.removed.duplicate_removed, report.removed.vertices_welded);
  if (report.removed.simplified)
    fmt::print("simplified       {} -> {} triangles, surface moved by at most {:.4f} m\n", report.removed.simplified->triangles_before,
               report.removed.simplified->triangles_after, report.removed.simplified->deviation_m);
  fmt::print("size             {:.2f} x {:.2f} x {:.2f} m\n", b.upper.x - b.lower.x, b.upper.y - b.lower.y, b.upper.z - b.lower.z);
  if (scene.origin_m() != glm::dvec3(0))
    fmt::print("origin           computation origin ({:.9g}, {:.9g}, {:.9g}); all positions are those of the file\n", scene.origin_m().x,
               scene.origin_m().y, scene.origin_m().z);
  print_axes(examined);
  print_cloud(examined);
  for (const std::string& warning : examined.warnings) fmt::print("warning          {}\n", warning);
}

/// Which material every surface got, and why.
void print_surfaces(const Scene& scene) {
  const std::vector<MaterialChoice>& choices = scene.import_report().choices;
  const std::vector<double> areas = slot_areas(scene);
  std::size_t widest = 0, widest_material = 0;
  for (std::size_t slot = 0; slot < choices.size(); ++slot) {
    widest = std::max(widest, scene.mesh().material_names[slot].size());
    widest_material = std::max(widest_material, scene.materials()[slot].name.size());
  }
  fmt::print("surfaces         {}\n", choices.size());
  for (std::size_t slot = 0; slot < choices.size(); ++slot)
    fmt::print("  {:<{}}  {:<{}}  {:>8.1f} m2  {}\n", scene.mesh().material_names[slot], widest, scene.materials()[slot].name,
               widest_material, areas[slot], reason_of(choices[slot]));
}

void print_openings(const ExaminedScene& examined) {
  const SceneReport& report = examined.report;
  fmt::print("open edges       {}\n", report.open_edges);
  fmt::print("ray efficiency   {:.4f}: {:.2f} % of rays leaked{}\n", report.ray_efficiency, 100 * report.leaked_ray_fraction,
             report.leaked_ray_fraction > 0.01 ? " (holes, or a missing ceiling: set ceiling_m in a scene YAML)" : "");
  for (const Hole& hole : examined.holes) {
    const glm::vec3 size = hole.bounds.upper - hole.bounds.lower;
    const glm::dvec3 centre = examined.scene->to_world(0.5f * (hole.bounds.lower + hole.bounds.upper));
    fmt::print("  hole           {:.2f} % of rays around ({:.2f}, {:.2f}, {:.2f}), {:.2f} x {:.2f} x {:.2f} m, next to {}\n",
               100 * hole.ray_fraction, centre.x, centre.y, centre.z, size.x, size.y, size.z, listed(hole.rim, ", "));
  }
}

void print_room(const ExaminedScene& examined) {
  const SceneReport& report = examined.report;
  // An open scene has no enclosed volume, nor a surface distinct from its outside.
  const auto shown = [](double value, const char* unit) {
    return std::isfinite(value) ? fmt::format("{:.1f} {}", value, unit) : std::string("-");
  };
  fmt::print("volume           {}\nsurface          {}\n", shown(report.volume_m3, "m3"), shown(report.area_m2, "m2"));
  if (examined.navigable_m2)
    fmt::print("navigable        {:.1f} m2\n", *examined.navigable_m2);
  else
    fmt::print("navigable        none ({})\n", examined.navigation_problem);
  fmt::print("RT60 estimate    ");
  for (std::size_t i = 0; i < report.rt60_estimate_s.size(); ++i)
    fmt::print("{}{:.0f} Hz {}", i == 0 ? "" : ", ", 125.0 * (1 << i),
               std::isfinite(report.rt60_estimate_s[i]) ? fmt::format("{:.2f} s", report.rt60_estimate_s[i]) : "-");
  fmt::print("\n");
}

Json point_json(glm::dvec3 p) { return {p.x, p.y, p.z}; }

Json holes_json(const ExaminedScene& examined) {
  Json list = Json::array();
  for (const Hole& hole : examined.holes) {
    list.push_back({{"ray_fraction", hole.ray_fraction},
                    {"lower", point_json(examined.scene->to_world(hole.bounds.lower))},
                    {"upper", point_json(examined.scene->to_world(hole.bounds.upper))},
                    {"rim", hole.rim}});
  }
  return list;
}

Json surfaces_json(const Scene& scene) {
  Json list = Json::array();
  const std::vector<MaterialChoice>& choices = scene.import_report().choices;
  const std::vector<double> areas = slot_areas(scene);
  for (std::size_t slot = 0; slot < choices.size(); ++slot)
    list.push_back({{"name", scene.mesh().material_names[slot]},
                    {"material", scene.materials()[slot].name},
                    {"area_m2", areas[slot]},
                    {"why", reason_of(choices[slot])}});
  return list;
}

/// null for a generated scene; guesses are null where nothing speaks against the axes as read.
Json axes_json(const ExaminedScene& examined) {
  const std::optional<FileAxes>& axes = examined.scene->import_report().axes;
  if (!axes) return nullptr;
  const AxesGuess& guess = examined.axes;
  return {{"unit_m", axes->unit_m},
          {"unit_given", axes->is_unit_given},
          {"unit_guess_m", guess.unit_m ? Json(*guess.unit_m) : Json(nullptr)},
          {"unit_why", guess.unit_why},
          {"up", std::string(1, axes->up)},
          {"up_given", axes->is_up_given},
          {"up_guess", guess.up ? Json(std::string(1, *guess.up)) : Json(nullptr)},
          {"up_why", guess.up_why}};
}

/// null for what is not a point cloud.
Json cloud_json(const ExaminedScene& examined) {
  const std::optional<CloudReport>& cloud = examined.scene->import_report().cloud;
  if (!cloud) return nullptr;
  return {{"points", cloud->points},
          {"invalid_points", cloud->invalid_points},
          {"stray_points", cloud->stray_points},
          {"cell_m", cloud->cell_m},
          {"cell_given", cloud->is_cell_given},
          {"spacing_m", cloud->is_cell_given ? Json(nullptr) : Json(cloud->spacing_m)},
          {"closed_width_m", cloud->closed_width_m},
          {"holes", cloud->holes},
          {"hole_area_m2", cloud->hole_area_m2},
          {"air_m3", cloud->air_m3},
          {"unseen_m3", cloud->unseen_m3}};
}

Json report_json(const ExaminedScene& examined, const EffectPlan& plan) {
  const Scene& scene = *examined.scene;
  const SceneReport& report = examined.report;
  const auto& simplified = report.removed.simplified;
  return {{"schema_version", 1},
          {"scene", scene.name()},
          {"triangles", report.triangles},
          {"removed",
           {{"degenerate", report.removed.degenerate_removed},
            {"duplicate", report.removed.duplicate_removed},
            {"welded_vertices", report.removed.vertices_welded}}},
          {"origin_m", point_json(scene.origin_m())},
          {"warnings", examined.warnings},
          {"axes", axes_json(examined)},
          {"cloud", cloud_json(examined)},
          {"surfaces", surfaces_json(scene)},
          {"open_edges", report.open_edges},
          {"ray_efficiency", report.ray_efficiency},
          {"leaked_ray_fraction", report.leaked_ray_fraction},
          {"holes", holes_json(examined)},
          {"simplified", simplified ? Json{{"triangles_before", simplified->triangles_before},
                                           {"triangles_after", simplified->triangles_after},
                                           {"deviation_m", simplified->deviation_m}}
                                    : Json(nullptr)},
          {"volume_m3", report.volume_m3},
          {"area_m2", report.area_m2},
          {"navigable_area_m2", examined.navigable_m2 ? Json(*examined.navigable_m2) : Json(nullptr)},
          {"rt60_estimate_s", numbers(report.rt60_estimate_s)},
          {"effects", plan_json(plan)}};
}

void run_scene(const SceneArguments& options) {
  const ExaminedScene examined = examine(options);
  print_mesh(examined);
  print_openings(examined);
  print_room(examined);
  print_surfaces(*examined.scene);
  if (!options.explain && options.json.empty()) return;
  const AcousticScene acoustics = acoustics_of(examined.scene, options);
  if (options.explain) print_plan(acoustics.plan());
  if (!options.json.empty()) write_file_atomically(options.json, json_text(report_json(examined, acoustics.plan()), 1) + "\n");
}

}  // namespace

void add_scene(CLI::App& app) {
  auto options = std::make_shared<SceneArguments>();
  CLI::App* command =
      app.add_subcommand("scene", "Check a scene: triangles, holes, ray efficiency, volume, RT60 estimate and navigable area");
  options->scene.add_to(*command);
  options->scene.add_simplify_to(*command);
  command->add_flag("--explain", options->explain,
                    "Also print the effect plan: each acoustic effect, whether it is simulated, its error bound and the time saved");
  command->add_option("--preset", options->preset, "Quality preset of the plan: fast (training), balanced or high (reference)")
      ->capture_default_str();
  command->add_option("--set", options->settings, "Override a key of the preset: key=value, as in 'earshot rir'; may be repeated");
  command->add_option("--json", options->json, "Also write the report to this JSON file")->type_name(kOutputFile);
  command->callback([options] { run_scene(*options); });
}

}  // namespace earshot
