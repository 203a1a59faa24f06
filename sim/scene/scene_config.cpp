// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_config.h"

#include <set>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

std::filesystem::path beside(const std::filesystem::path& yaml, const std::string& name) {
  return (yaml.parent_path() / name).lexically_normal();
}

void read_rules(ConfigReader& reader, MaterialRules& rules) {
  ConfigReader assign = reader.child("assign", "Materials by pattern over mesh-material and node names, an exact name first.");
  std::set<std::string> seen;
  for (const std::string& pattern : assign.free_keys("PATTERN")) {
    if (!seen.insert(pattern).second) assign.fail(pattern, "occurs twice");
    std::string material;
    assign.read_required(pattern, material, Allowed::text("the name of a material"),
                         "Material of what matches, such as \"Wall*\": gypsum_board.");
    rules.assign.emplace_back(pattern, material);
  }
  assign.finish();
  std::optional<std::string> rest;
  reader.read("default_material", rest, Allowed::text("the name of a material"), "Material of what no pattern matches.");
  if (rest && rest->empty()) reader.fail("default_material", "is empty");
  if (rest) rules.default_material = *rest;
}

void read_semantics(ConfigReader& reader, const std::filesystem::path& path, SceneConfig& config) {
  std::optional<std::string> name;
  reader.read("semantics", name, Allowed::text("indoor, or a file as configs/semantic_materials.yaml"),
              "Materials by semantic category of mesh-material and node names. Absent: categories have no effect.");
  if (name) {
    config.own_semantics = *name != "indoor";
    config.rules.semantics = std::make_shared<const SemanticMaterials>(
        config.own_semantics ? SemanticMaterials::from_file(beside(path, *name)) : SemanticMaterials::indoor());
  }
  reader.read_choice<LabelMatching>("label_matching", config.rules.label_matching,
                                    {{"exact", LabelMatching::exact}, {"legacy_substring", LabelMatching::legacy_substring}},
                                    "Match of the labels of a material database. exact: whole words. legacy_substring: as SoundSpaces.");
  if (!reader.asks_for("randomize")) return;
  AcousticRandomization& randomization = config.randomization.emplace();
  ConfigReader child = reader.child("randomize", "Random materials; {} takes the defaults. With candidates it implies semantics: indoor.");
  child.read("seed", randomization.seed, "Seed of the materials.");
  read(child, randomization);
  child.finish();
  if (randomization.candidates && !config.rules.semantics)
    config.rules.semantics = std::make_shared<const SemanticMaterials>(SemanticMaterials::indoor());
}

void read_air(ConfigReader& reader, Air& air) {
  ConfigReader child = reader.child("air", "State of the air: speed of sound and absorption.");
  child.read("temperature_c", air.temperature_c, Allowed::between(-20, 50), "Temperature.");
  child.read("humidity_percent", air.humidity_percent, Allowed::between(0, 100), "Relative humidity.");
  child.read("pressure_kpa", air.pressure_kpa, Allowed::between(50, 120), "Atmospheric pressure.");
  child.read("speed_of_sound_m_per_s", air.speed_of_sound_m_per_s, Allowed::between(100, 2000).or_value(0),
             "Speed of sound. 0: from the temperature (ISO 9613-1).");
  child.finish();
}

void read_mesh(ConfigReader& reader, SceneConfig& config) {
  reader.read_required("mesh", config.mesh, Allowed::text("a mesh file, relative to this file, shoebox:..., house:... or floor:..."),
                       "Geometry of the scene.");
  config.is_up_given = reader.has("up");
  config.is_unit_given = reader.has("unit_m");
  reader.read_choice<MeshImportOptions::Up>("up", config.import.up, {{"y", MeshImportOptions::Up::y}, {"z", MeshImportOptions::Up::z}},
                                            "Axis of the mesh file that points up.");
  reader.read("unit_m", config.import.unit_m, Allowed::between(1e-6, 1e6), "Length of one unit of the mesh file.");
  reader.read("cell_m", config.import.cell_m, Allowed::between(kMinCellM, kMaxCellM),
              "Edge of the voxels of a point cloud. Absent: from the spacing of its points.");
  reader.read("ceiling_m", config.ceiling_m, Allowed::any(),
              "Height of a lid over the bounding rectangle, called ceiling_lid. Absent: no lid.");
  reader.read("simplify_m", config.simplify_m, Allowed::above(0).up_to(1),
              "Distance by which surfaces may move to save triangles. Absent: no simplification.");
}

void read(ConfigReader& reader, const std::filesystem::path& path, SceneConfig& config) {
  read_mesh(reader, config);
  std::optional<std::string> annotations;
  reader.read("annotations", annotations, Allowed::text("a .house, an info_semantic.json or a .semantic.txt, relative to this file"),
              "Categories of the surfaces of a scanned mesh. Absent: the file beside the mesh that the data set calls so.");
  if (annotations) config.annotations = beside(path, *annotations);
  std::optional<std::string> materials;
  reader.read("materials", materials, Allowed::text("a material database"), "Material database (JSON). Absent: the built-in one.");
  if (materials) config.materials = beside(path, *materials);
  if (reader.asks_for("coefficients")) {
    if (!config.materials && !reader.is_describing())
      reader.fail("coefficients", "has no effect without `materials`: the built-in materials use energy coefficients");
    reader.read_choice<CoefficientReading>("coefficients", config.coefficients.emplace(CoefficientReading::energy),
                                           {{"energy", CoefficientReading::energy}, {"pressure", CoefficientReading::pressure}},
                                           "Meaning of the numbers of materials; default: what that file says, else energy.");
  }
  read_rules(reader, config.rules);
  read_semantics(reader, path, config);
  read_air(reader, config.air);
  bool two_sided = true;
  reader.read("two_sided", two_sided, "Surfaces reflect from both sides; true is the only value.");
  if (!two_sided) reader.fail("two_sided", "must be true: surfaces reflect on both sides, independent of their winding");
}

}  // namespace

SceneConfig read_scene_config(const std::filesystem::path& path) {
  ConfigReader reader = ConfigReader::from_file(path);
  SceneConfig config;
  read(reader, path, config);
  if (config.mesh.empty()) reader.fail("mesh", "is empty");
  if (!config.mesh.starts_with("shoebox:") && !config.mesh.starts_with("house:") && !config.mesh.starts_with("floor:"))
    config.mesh = beside(path, config.mesh).string();
  reader.finish();
  return config;
}

std::vector<ConfigKey> scene_config_keys() {
  ConfigReader describer = ConfigReader::describer();
  SceneConfig config;
  read(describer, {}, config);
  return describer.described();
}

}  // namespace earshot
