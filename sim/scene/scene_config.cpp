#include "sim/scene/scene_config.h"

#include <fmt/format.h>

#include <cmath>
#include <set>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

std::filesystem::path beside(const std::filesystem::path& yaml, const std::string& name) {
  return (yaml.parent_path() / name).lexically_normal();
}

MaterialRules read_rules(ConfigReader& reader) {
  MaterialRules rules;
  ConfigReader assign = reader.child("assign");
  std::set<std::string> seen;
  for (const std::string& pattern : assign.keys()) {
    if (!seen.insert(pattern).second) assign.fail(pattern, "occurs twice");
    const std::optional<std::string> material = assign.scalar(pattern);
    if (!material) assign.fail(pattern, "is not the name of a material");
    rules.assign.emplace_back(pattern, *material);
  }
  assign.finish();
  if (reader.has("default_material")) {
    reader.read("default_material", rules.default_material);
    if (rules.default_material.empty()) reader.fail("default_material", "is empty");
  }
  return rules;
}

void read_semantics(ConfigReader& reader, const std::filesystem::path& path, SceneConfig& config) {
  if (reader.has("semantics")) {
    std::string name;
    reader.read("semantics", name);
    config.own_semantics = name != "indoor";
    config.rules.semantics = std::make_shared<const SemanticMaterials>(
        config.own_semantics ? SemanticMaterials::from_file(beside(path, name)) : SemanticMaterials::indoor());
  }
  reader.read_choice<LabelMatching>("label_matching", config.rules.label_matching,
                                    {{"exact", LabelMatching::exact}, {"legacy_substring", LabelMatching::legacy_substring}});
  if (!reader.has("randomize")) return;
  AcousticRandomization& randomization = config.randomization.emplace();
  ConfigReader child = reader.child("randomize");
  child.read("seed", randomization.seed);
  child.read("candidates", randomization.candidates);
  child.read("noise_std", randomization.noise_std);
  child.read("transmission_noise_db", randomization.transmission_noise_db);
  child.finish();
  validate(randomization, reader.where());
  if (randomization.candidates && !config.rules.semantics)
    config.rules.semantics = std::make_shared<const SemanticMaterials>(SemanticMaterials::indoor());
}

Air read_air(ConfigReader& reader) {
  Air air;
  ConfigReader child = reader.child("air");
  child.read("temperature_c", air.temperature_c);
  child.read("humidity_percent", air.humidity_percent);
  child.read("pressure_kpa", air.pressure_kpa);
  child.read("speed_of_sound_m_per_s", air.speed_of_sound_m_per_s);
  child.finish();
  validate(air, reader.where());
  return air;
}

}  // namespace

void validate(const Air& air, const std::string& where) {
  const auto check = [&](const char* key, float value, float lowest, float highest) {
    if (value >= lowest && value <= highest) return;  // also refuses NaN
    throw InputError(fmt::format("{}: air.{} = {}", where, key, value), fmt::format("is outside [{}, {}]", lowest, highest),
                     "use a value in this range");
  };
  check("temperature_c", air.temperature_c, -20, 50);
  check("humidity_percent", air.humidity_percent, 0, 100);
  check("pressure_kpa", air.pressure_kpa, 50, 120);
  if (air.speed_of_sound_m_per_s != 0) check("speed_of_sound_m_per_s", air.speed_of_sound_m_per_s, 100, 2000);
}

SceneConfig read_scene_config(const std::filesystem::path& path) {
  ConfigReader reader = ConfigReader::from_file(path);
  SceneConfig config;
  reader.read_required("mesh", config.mesh);
  if (config.mesh.empty()) reader.fail("mesh", "is empty");
  if (!config.mesh.starts_with("shoebox:") && !config.mesh.starts_with("house:") && !config.mesh.starts_with("floor:"))
    config.mesh = beside(path, config.mesh).string();

  config.is_up_given = reader.has("up");
  config.is_unit_given = reader.has("unit_m");
  reader.read_choice<MeshImportOptions::Up>("up", config.import.up, {{"y", MeshImportOptions::Up::y}, {"z", MeshImportOptions::Up::z}});
  reader.read("unit_m", config.import.unit_m);
  if (!(config.import.unit_m >= 1e-6 && config.import.unit_m <= 1e6)) reader.fail("unit_m", "must be in [1e-6, 1e6] metres per unit");
  if (reader.has("ceiling_m")) {
    reader.read("ceiling_m", config.ceiling_m.emplace());
    if (!std::isfinite(*config.ceiling_m)) reader.fail("ceiling_m", "must be a finite height in metres");
  }
  if (reader.has("simplify_m")) {
    reader.read("simplify_m", config.simplify_m.emplace());
    if (!(*config.simplify_m > 0 && *config.simplify_m <= 1)) reader.fail("simplify_m", "must be in (0, 1] m");
  }
  if (reader.has("materials")) {
    std::string name;
    reader.read("materials", name);
    config.materials = beside(path, name);
  }
  if (reader.has("coefficients")) {
    if (!config.materials) reader.fail("coefficients", "has no effect without `materials`: the built-in materials use energy coefficients");
    reader.read_choice<CoefficientReading>("coefficients", config.coefficients.emplace(),
                                           {{"energy", CoefficientReading::energy}, {"pressure", CoefficientReading::pressure}});
  }
  config.rules = read_rules(reader);
  read_semantics(reader, path, config);
  config.air = read_air(reader);
  bool two_sided = true;
  reader.read("two_sided", two_sided);
  if (!two_sided) reader.fail("two_sided", "must be true: surfaces reflect on both sides, independent of their winding");
  reader.finish();
  return config;
}

}  // namespace earshot
