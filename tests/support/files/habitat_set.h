// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/base/text/json.h"

namespace earshot {

/// A data set of Habitat in the form of ReplicaCAD, and the same scene put together by hand as one OBJ; knows nothing of the readers.
/// A room with boxes in it; sizes, frames, units, scales, places and classes are drawn.  With exact turns (by 90 and 120 degrees) all
/// positions are multiples of powers of two, which text and floats hold exactly.
class HabitatSet {
 public:
  using Json = nlohmann::json;

  struct Template {
    std::string name, material;
    glm::dvec3 lower, upper;  ///< box, in asset coordinates
    bool is_z_up = false;     ///< up [0, 0, 1], front [0, 1, 0]
    double unit = 1, scale = 1;
    int semantic_id = -1;  ///< -1: none
    bool has_mass = false;
  };
  struct Instance {
    std::size_t model = 0;
    glm::dvec3 translation{0};
    std::array<double, 4> rotation{1, 0, 0, 0};
    double uniform = 1;
    glm::dvec3 axes{1};
    std::string origin;  ///< "", "COM" or "asset_local"
  };

  glm::dvec3 size{0};
  bool is_stage_z_up = false;
  double stage_unit = 1;
  glm::dvec3 stage_translation{0};
  std::array<double, 4> stage_rotation{1, 0, 0, 0};
  std::string scene_origin;
  bool has_looks = false;  ///< objects name a material library, NAME.mtl
  std::vector<Template> templates;
  std::vector<Instance> instances;

  explicit HabitatSet(std::uint32_t number, bool is_exact = true) : random_(2041, Purpose::test, number) {
    size = {grid(4, 8), grid(2, 4), grid(4, 8)};
    is_stage_z_up = draw() < 0.5;
    stage_unit = pick<double>({0.5, 1, 2});
    stage_translation = {grid(-3, 3), grid(-1, 1), grid(-3, 3)};
    stage_rotation = pick<std::array<double, 4>>({{1, 0, 0, 0}, {0, 0, 1, 0}});
    scene_origin = pick<std::string>({"", "COM", "asset_local"});
    for (const char* name : {"oak_table", "sofa_02", "lamp"}) {
      const glm::dvec3 lower{grid(-0.5, 0), grid(-0.5, 0), grid(-0.5, 0)};
      templates.push_back({.name = name,
                           .material = fmt::format("own{}", templates.size()),
                           .lower = lower,
                           .upper = lower + glm::dvec3(grid(0.25, 0.75), grid(0.25, 0.75), grid(0.25, 0.75)),
                           .is_z_up = draw() < 0.5,
                           .unit = pick<double>({0.5, 1, 2}),
                           .scale = pick<double>({0.5, 1}),
                           .semantic_id = pick<int>({-1, 7, 12, 99}),
                           .has_mass = draw() < 0.5});
    }
    for (std::size_t i = 0; i < 5; ++i) {
      Instance made{
          .model = i % 3, .uniform = pick<double>({0.5, 1, 1.25}), .origin = pick<std::string>({"", "COM", "asset_local", "com"})};
      // Well within the room, and no two in one place.
      made.translation = to_room({std::round(size.x * (3.2 + 2.4 * static_cast<double>(i))) / 16, 0.5 * size.y, grid(0.25, 0.75) * size.z});
      made.rotation =
          is_exact ? pick<std::array<double, 4>>({{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 0, -1}, {0.5, 0.5, 0.5, 0.5}, {0.5, -0.5, 0.5, -0.5}})
                   : any_rotation();
      if (!templates[made.model].is_z_up) made.axes = {pick<double>({0.5, 1, 2}), pick<double>({-1.0, 1.0}), pick<double>({0.5, 1})};
      instances.push_back(made);
    }
  }

  /// From coordinates of the room, one corner at 0, to those of the scene.
  [[nodiscard]] glm::dvec3 to_room(glm::dvec3 p) const { return turn(stage_rotation, p) + stage_translation; }
  [[nodiscard]] glm::dvec3 source() const { return to_room(size * glm::dvec3(0.1, 0.9, 0.1)); }
  [[nodiscard]] glm::dvec3 listener() const { return to_room(size * glm::dvec3(0.9, 0.9, 0.9)); }

  /// Class of a semantic_id; empty for none.
  static std::string class_of(int semantic_id) { return semantic_id == 7 ? "table" : semantic_id == 12 ? "sofa" : ""; }
  [[nodiscard]] std::string material_of(const Instance& instance) const {
    const Template& model = templates[instance.model];
    return class_of(model.semantic_id).empty() ? model.material : class_of(model.semantic_id);
  }

  /// By the definition of a rotation by a quaternion, v + 2 w (q x v) + 2 q x (q x v).
  static glm::dvec3 turn(const std::array<double, 4>& wxyz, glm::dvec3 v) {
    const glm::dvec3 q(wxyz[1], wxyz[2], wxyz[3]);
    return v + 2 * wxyz[0] * glm::cross(q, v) + 2.0 * glm::cross(q, glm::cross(q, v));
  }
  /// What the frame does: z up and y in front become y up and -z in front.
  static glm::dvec3 turn_up(bool is_z_up, glm::dvec3 p) { return is_z_up ? glm::dvec3(p.x, p.z, -p.y) : p; }

  [[nodiscard]] glm::dvec3 world_of(const Instance& instance, glm::dvec3 p) const {
    const Template& model = templates[instance.model];
    const auto scaled = [&](glm::dvec3 at) {
      return turn_up(model.is_z_up, at) * model.unit * model.scale * instance.uniform * instance.axes;
    };
    const std::string& origin = instance.origin.empty() ? scene_origin : instance.origin;
    glm::dvec3 center(0);
    if (origin != "asset_local" && !model.has_mass) center = 0.5 * (scaled(model.lower) + scaled(model.upper));
    return turn(instance.rotation, scaled(p) - center) + instance.translation;
  }

  /// The scene as one file, in metres: names written by hand.
  [[nodiscard]] std::string obj() const {
    std::string text;
    std::size_t num_vertices = 0;
    append_stage(text, num_vertices, [&](glm::dvec3 p) { return to_room(turn_up(is_stage_z_up, p) * stage_unit); });
    for (std::size_t i = 0; i < instances.size(); ++i) {
      const Template& model = templates[instances[i].model];
      const std::string category = class_of(model.semantic_id);
      append_box(text, num_vertices, fmt::format("{}_{}", category.empty() ? model.name : category, i), material_of(instances[i]),
                 model.lower, model.upper, [&](glm::dvec3 p) { return world_of(instances[i], p); });
    }
    return text;
  }

  /// Writes all files by write(name, text).
  void write(const std::function<void(const std::string&, const std::string&)>& write) const {
    for (const auto& [name, json] : jsons()) write(name, json_text(json));
    std::string text;
    std::size_t num_vertices = 0;
    append_stage(text, num_vertices, [](glm::dvec3 p) { return p; });
    write("stages/flat.obj", text);
    for (const Template& model : templates) {
      text = has_looks ? "mtllib " + model.name + ".mtl\n" : "";
      num_vertices = 0;
      append_box(text, num_vertices, "any", model.material, model.lower, model.upper, [](glm::dvec3 p) { return p; });
      write("objects/" + model.name + ".obj", text);
    }
  }
  static constexpr const char* kConfig = "cad.scene_dataset_config.json";
  static constexpr const char* kScene = "configs/scenes/apt_0.scene_instance.json";

  /// The JSON files by name.
  [[nodiscard]] std::map<std::string, Json> jsons() const {
    std::map<std::string, Json> files;
    files[kConfig] = {
        {"stages", {{"paths", {{".json", {"configs/stages"}}}}, {"default_attributes", {{"gravity", {0, -9.8, 0}}}}}},
        {"objects", {{"paths", {{".json", {"configs/obj*"}}}}}},
        {"articulated_objects", {{"paths", {{".urdf", {"urdf/*/"}}}}}},
        {"light_setups", Json::object()},
        {"scene_instances", {{"default_attributes", {{"default_lighting", ""}}}, {"paths", {{".json", {"configs/scenes/"}}}}}},
        {"navmesh_instances", {{"empty", "navmeshes/apt.navmesh"}}},
        {"semantic_scene_descriptor_instances", {{"lexicon", "configs/ssd/lexicon.json"}}}};
    Json stage = {{"render_asset", "../../stages/flat.obj"}, {"units_to_meters", stage_unit}, {"margin", 0.04}};
    add_frame(stage, is_stage_z_up);
    files["configs/stages/flat.stage_config.json"] = stage;
    for (const Template& model : templates) {
      Json object = {{"render_asset", "../../objects/" + model.name + ".obj"}, {"mass", 1.5}, {"units_to_meters", model.unit}};
      object["scale"] = {model.scale, model.scale, model.scale};
      add_frame(object, model.is_z_up);
      if (model.semantic_id >= 0) object["semantic_id"] = model.semantic_id;
      if (model.has_mass) object["COM"] = {0, 0, 0};
      files["configs/objects/" + model.name + ".object_config.json"] = object;
    }
    Json scene = {{"stage_instance",
                   {{"template_name", "stages/flat"},
                    {"translation", {stage_translation.x, stage_translation.y, stage_translation.z}},
                    {"rotation", stage_rotation}}},
                  {"default_lighting", "lighting/any"},
                  {"navmesh_instance", "empty"},
                  {"semantic_scene_instance", "lexicon"},
                  {"object_instances", Json::array()}};
    if (!scene_origin.empty()) scene["translation_origin"] = scene_origin;
    for (const Instance& one : instances) {
      Json instance = {{"template_name", "objects/" + templates[one.model].name},
                       {"motion_type", "STATIC"},
                       {"translation", {one.translation.x, one.translation.y, one.translation.z}},
                       {"rotation", one.rotation},
                       {"uniform_scale", one.uniform},
                       {"non_uniform_scale", {one.axes.x, one.axes.y, one.axes.z}}};
      if (!one.origin.empty()) instance["translation_origin"] = one.origin;
      scene["object_instances"].push_back(instance);
    }
    files[kScene] = scene;
    files["configs/ssd/lexicon.json"] = {
        {"classes", {{{"id", 0}, {"name", "undefined"}}, {{"id", 7}, {"name", "table"}}, {{"id", 12}, {"name", "sofa"}}}}};
    return files;
  }

 private:
  double draw() { return static_cast<double>(random_.uniform(next_++)); }
  double grid(double lower, double upper) { return std::round(16 * (lower + (upper - lower) * draw())) / 16; }
  template <class T>
  T pick(const std::vector<T>& choices) {
    return choices[static_cast<std::size_t>(draw() * static_cast<double>(choices.size()))];
  }
  std::array<double, 4> any_rotation() {
    std::array<double, 4> q{};
    double length = 0;
    while (!(length > 0.1)) {
      length = 0;
      for (double& number : q) number = 2 * draw() - 1, length += number * number;
    }
    for (double& number : q) number /= std::sqrt(length);
    return q;
  }
  static void add_frame(Json& json, bool is_z_up) {
    json["up"] = is_z_up ? Json{0, 0, 1} : Json{0, 1, 0};
    json["front"] = is_z_up ? Json{0, 1, 0} : Json{0, 0, -1};
  }

  template <class Place>
  static void append_faces(std::string& text, std::size_t& num_vertices, glm::dvec3 lower, glm::dvec3 upper,
                           const std::array<std::string, 6>& heads, Place place) {
    for (unsigned corner = 0; corner < 8; ++corner) {
      const glm::dvec3 p =
          place(glm::dvec3(corner & 1u ? upper.x : lower.x, corner & 2u ? upper.y : lower.y, corner & 4u ? upper.z : lower.z));
      text += fmt::format("v {:.17g} {:.17g} {:.17g}\n", p.x, p.y, p.z);
    }
    constexpr std::array<std::array<std::size_t, 4>, 6> sides{
        {{0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}, {0, 1, 3, 2}, {4, 6, 7, 5}}};
    for (std::size_t side = 0; side < 6; ++side) {
      text += heads[side];
      const auto [a, b, c, d] = sides[side];
      for (const auto& [i, j, k] : {std::array{a, b, c}, std::array{a, c, d}})
        text += fmt::format("f {} {} {}\n", num_vertices + i + 1, num_vertices + j + 1, num_vertices + k + 1);
    }
    num_vertices += 8;
  }
  template <class Place>
  static void append_box(std::string& text, std::size_t& num_vertices, const std::string& object, const std::string& material,
                         glm::dvec3 lower, glm::dvec3 upper, Place place) {
    append_faces(text, num_vertices, lower, upper, {fmt::format("o {}\nusemtl {}\n", object, material)}, place);
  }
  /// In the coordinates of its asset.
  template <class Place>
  void append_stage(std::string& text, std::size_t& num_vertices, Place place) const {
    // Low and high y of the asset's box are floor and ceiling only where y is up.
    const glm::dvec3 upper = (is_stage_z_up ? glm::dvec3(size.x, -size.z, size.y) : size) / stage_unit;
    const char *low = is_stage_z_up ? "wall" : "floor", *high = is_stage_z_up ? "wall" : "ceiling";
    const char *z_low = is_stage_z_up ? "floor" : "wall", *z_high = is_stage_z_up ? "ceiling" : "wall";
    const auto head = [](const char* name, int number) { return fmt::format("o part{}\nusemtl {}\n", number, name); };
    append_faces(text, num_vertices, glm::dvec3(0), upper,
                 {head(low, 1), head(high, 2), head("wall", 3), head("wall", 4), head(z_low, 5), head(z_high, 6)}, place);
  }

  RandomStream random_;
  std::uint32_t next_ = 0;
};

}  // namespace earshot
