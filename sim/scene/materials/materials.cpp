// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/materials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"
#include "sim/base/text/json_keys.h"
#include "sim/base/text/schema_version.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/materials/material_keys.h"
#include "sim/scene/materials/wall_impedance.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

constexpr const char* kVersionKey = "schema_version";

/// One entry of "materials", with its name for messages.
struct Entry {
  const Json& json;
  std::string where;  // file: material "name"
  [[noreturn]] void fail(const std::string& key, const std::string& problem, const std::string& remedy) const {
    throw InputError(where + ", key '" + key + "'", problem, remedy);
  }
};

float read_number(const Entry& entry, const std::string& key, const Json& json) {
  if (!json.is_number()) entry.fail(key, fmt::format("{} is not a number", json_text_of_any_bytes(json)), "write a number");
  const auto value = json.get<float>();
  if (!std::isfinite(value)) entry.fail(key, "the number is too large", "write a finite number");
  return value;
}

/// [f0, c0, f1, c1, ...]: any order; of equal frequencies the last wins.
CoefficientCurve read_curve(const Entry& entry, const std::string& key) {
  const auto largest = static_cast<float>(material_entry_key(key).allowed.high);
  const Json& list = entry.json.at(key);
  if (!list.is_array() || list.empty() || list.size() % 2 != 0) {
    entry.fail(key, "is not a list of pairs", "write [Hz, value, Hz, value, ...]");
  }
  std::map<float, float> points;
  for (std::size_t i = 0; i < list.size(); i += 2) {
    const float hz = read_number(entry, key, list[i]), value = read_number(entry, key, list[i + 1]);
    if (!(hz > 0)) entry.fail(key, fmt::format("frequency {} Hz is not positive", hz), "write frequencies above 0 Hz");
    if (!(value >= 0 && value <= largest)) {
      entry.fail(key, fmt::format("{} at {} Hz is outside [0, {}]", value, hz, largest),
                 largest == 1 ? "coefficients are fractions of the energy" : "write dB per metre");
    }
    points[hz] = value;
  }
  CoefficientCurve curve;
  for (const auto& [hz, value] : points) {
    curve.hz.push_back(hz);
    curve.value.push_back(value);
  }
  return curve;
}

/// Whether the surface is locally reacting, and its impedance, with the absorption that belongs to it.
void read_angle(const Entry& entry, Material& material) {
  const Json& json = entry.json;
  if (json.contains("angle")) {
    if (json["angle"] != "random" && json["angle"] != "locally_reacting")
      entry.fail("angle", json_text_of_any_bytes(json["angle"]) + " is not known", "write \"random\" or \"locally_reacting\"");
    material.locally_reacting = json["angle"] == "locally_reacting";
  }
  if (!json.contains("impedance")) return;
  if (json.contains("angle") && !material.locally_reacting)
    entry.fail("angle", "is random beside an impedance", "write \"locally_reacting\", or leave one of them out");
  if (json.contains("absorption")) entry.fail("absorption", "is given beside an impedance", "leave it out: it follows from the impedance");
  material.locally_reacting = true;
  const Json& list = json["impedance"];
  if (!list.is_array() || list.empty() || list.size() % 3 != 0)
    entry.fail("impedance", "is not a list of triples", "write [Hz, real, imaginary, Hz, real, imaginary, ...]");
  const auto largest = static_cast<float>(material_entry_key("impedance").allowed.high);
  std::map<float, std::complex<float>> points;
  for (std::size_t i = 0; i < list.size(); i += 3) {
    const float hz = read_number(entry, "impedance", list[i]), real = read_number(entry, "impedance", list[i + 1]),
                imaginary = read_number(entry, "impedance", list[i + 2]);
    if (!(hz > 0)) entry.fail("impedance", fmt::format("frequency {} Hz is not positive", hz), "write frequencies above 0 Hz");
    if (!(real > 0 && real <= largest && std::abs(imaginary) <= largest))
      entry.fail("impedance", fmt::format("{} + {} j at {} Hz is not possible", real, imaginary, hz),
                 fmt::format("write a real part above 0, and numbers up to {:.0e}", largest));
    points[hz] = {real, imaginary};
  }
  for (const auto& [hz, impedance] : points) {
    for (CoefficientCurve* curve : {&material.impedance_real, &material.impedance_imaginary, &material.absorption}) curve->hz.push_back(hz);
    material.impedance_real.value.push_back(impedance.real());
    material.impedance_imaginary.value.push_back(impedance.imag());
    material.absorption.value.push_back(static_cast<float>(random_incidence_absorption(std::complex<double>(impedance))));
  }
}

std::string read_text(const Entry& entry, const std::string& key) {
  if (!entry.json.contains(key)) entry.fail(key, "is missing", "add it");
  if (!entry.json[key].is_string()) entry.fail(key, "is not text", "write it in quotes");
  return entry.json[key].get<std::string>();
}

/// Of a pressure ratio to a fraction of the energy.
void read_as_pressure(Material& material) {
  for (float& value : material.absorption.value) value = 1.f - (1.f - value) * (1.f - value);
  for (float& value : material.transmission.value) value *= value;
}

void read_source(const Entry& entry, Material& material) {
  const std::set<std::string>& known = material_source_keys();
  if (!entry.json.contains("source")) return;
  const Json& json = entry.json["source"];
  if (!json.is_object()) {
    material.source = read_text(entry, "source");
    return;
  }
  const Entry inner{json, entry.where + ", key 'source'"};
  for (const auto& [key, unused] : json.items()) {
    const std::string nearest = nearest_word(key, known);
    if (!known.contains(key)) inner.fail(key, "is unknown", nearest.empty() ? "remove it" : "did you mean '" + nearest + "'?");
    material.sources[key] = read_text(inner, key);
    material.source += (material.source.empty() ? "" : "; ") + key + ": " + material.sources[key];
  }
}

/// A wall cannot transmit more than it does not reflect.  Strict without a list of warnings.
void limit_transmission(const Entry& entry, Material& material, std::vector<MaterialWarning>* warnings) {
  // Both are lines between their knots, so the difference is largest at a knot of one of them.
  std::set<float> knots(material.absorption.hz.begin(), material.absorption.hz.end());
  knots.insert(material.transmission.hz.begin(), material.transmission.hz.end());
  CoefficientCurve limited;
  for (const float hz : knots) {
    const float a = material.absorption.at(hz), t = material.transmission.at(hz);
    limited.hz.push_back(hz);
    limited.value.push_back(std::min(a, t));
    if (t <= a + 1e-6f) continue;  // 1e-6: rounding of interpolated knots
    const std::string problem = fmt::format("{:.4g} exceeds the absorption {:.4g} at {:.4g} Hz", t, a, hz);
    if (!warnings)
      entry.fail("transmission", problem, "absorption counts all that is not reflected, so it includes the transmitted fraction");
    warnings->push_back({material.name, "transmission " + problem + "; lowered to the absorption"});
  }
  material.transmission = std::move(limited);
}

Material read_material(const Json& json, std::size_t index, const std::string& where, const MaterialImport& import) {
  const std::set<std::string>& known = material_entry_keys();
  Entry entry{json, fmt::format("{}: material {}", where, index)};
  if (!json.is_object()) throw InputError(entry.where, "is not an object", "write {\"name\": ..., \"absorption\": [...], ...}");
  Material material;
  material.name = read_text(entry, "name");
  if (material.name.empty()) entry.fail("name", "is empty", "give each material a name");
  entry.where = where + ": material '" + material.name + "'";
  for (const auto& [key, unused] : json.items()) {
    if (known.contains(key)) continue;
    const std::string nearest = nearest_word(key, known);
    entry.fail(key, "is unknown", nearest.empty() ? "remove it" : "did you mean '" + nearest + "'?");
  }
  for (const char* key : {"absorption", "scattering"}) {
    if (!json.contains(key) && (std::string_view(key) == "scattering" || !json.contains("impedance")))
      entry.fail(key, "is missing", "add [Hz, value, ...]");
  }
  read_angle(entry, material);
  if (json.contains("absorption")) material.absorption = read_curve(entry, "absorption");
  material.scattering = read_curve(entry, "scattering");
  material.transmission = json.contains("transmission") ? read_curve(entry, "transmission") : CoefficientCurve::constant(0);
  material.damping_db_per_m = json.contains("damping") ? read_curve(entry, "damping") : CoefficientCurve::constant(0);
  if (import.reading == CoefficientReading::pressure && material.impedance_real.hz.empty()) read_as_pressure(material);
  if (!import.keep_transmission) limit_transmission(entry, material, import.warnings);
  if (material.locally_reacting && std::ranges::any_of(material.transmission.value, [](float tau) { return tau > 0; }))
    entry.fail("angle", "is that of a surface that transmits", "a locally reacting surface transmits nothing here; leave one of them out");
  if (json.contains("labels")) {
    if (!json["labels"].is_array()) entry.fail("labels", "is not a list", "write [\"wall\", ...]");
    for (const Json& label : json["labels"]) {
      if (!label.is_string()) entry.fail("labels", "contains an entry that is not text", "write each label in quotes");
      material.labels.push_back(label.get<std::string>());
    }
  }
  if (json.contains("speed")) material.speed_m_per_s = read_number(entry, "speed", json["speed"]);
  if (json.contains("density")) material.density_kg_per_m3 = read_number(entry, "density", json["density"]);
  if (material.speed_m_per_s < 0) entry.fail("speed", "is negative", "write metres per second");
  if (material.density_kg_per_m3 < 0) entry.fail("density", "is negative", "write kilograms per cubic metre");
  read_source(entry, material);
  return material;
}

/// The reading that the file declares, if any.
std::optional<CoefficientReading> read_reading(const Json& json, const std::string& where) {
  if (!json.contains("coefficients")) return std::nullopt;
  if (json["coefficients"] == "energy") return CoefficientReading::energy;
  if (json["coefficients"] == "pressure") return CoefficientReading::pressure;
  throw InputError(where, "key 'coefficients' is neither \"energy\" nor \"pressure\"",
                   "write one of them: fractions of the energy, or of the pressure");
}

constexpr std::string_view builtin_json =
#include "builtin_materials.inc"
    ;

}  // namespace

const std::string& Material::source_of(const std::string& key) const {
  const auto found = sources.find(key);
  return found == sources.end() ? source : found->second;
}

MaterialDatabase MaterialDatabase::from_json(std::string_view text, const std::string& where, const MaterialImport& import) {
  check_json_depth(text, where);
  Json json;
  try {
    json = parse_json(text);
  } catch (const Json::parse_error& error) {
    throw InputError(where, fmt::format("is not JSON: error at byte {}", error.byte), "correct the syntax there");
  } catch (const Json::exception&) {
    throw InputError(where, "is not JSON: a number is out of range", "write finite numbers");
  }
  check_unique_keys(text, where);
  try {
    check_schema_version(json, kVersionKey, where, "a material database", {1, 1});
  } catch (const Json::exception& error) {
    throw InputError(where, error.what(), "write 1");
  }
  if (!json.is_object() || !json.contains("materials") || !json["materials"].is_array()) {
    throw InputError(where, "has no list 'materials'", "write {\"materials\": [...]}");
  }
  for (const auto& [key, unused] : json.items()) {
    if (key != "materials" && key != "coefficients" && key != kVersionKey) {
      throw InputError(where, "key '" + key + "' is unknown", "the keys here are 'materials' and 'coefficients'");
    }
  }
  MaterialImport resolved = import;
  if (const auto written = read_reading(json, where)) {
    if (import.reading && *import.reading != *written) {
      throw InputError(where, "has another value of 'coefficients' than the scene", "remove 'coefficients' from one of them");
    }
    resolved.reading = written;
  }
  MaterialDatabase database;
  std::set<std::string> names;
  for (const Json& entry : json["materials"]) {
    database.materials_.push_back(read_material(entry, database.materials_.size(), where, resolved));
    if (!names.insert(database.materials_.back().name).second) {
      throw InputError(where, "material '" + database.materials_.back().name + "' occurs twice", "rename or remove one of them");
    }
  }
  return database;
}

MaterialDatabase MaterialDatabase::from_json(std::string_view text, const std::string& where, std::vector<MaterialWarning>* warnings) {
  return from_json(text, where, MaterialImport{.reading = std::nullopt, .warnings = warnings});
}

MaterialDatabase MaterialDatabase::from_file(const std::filesystem::path& path, const MaterialImport& import) {
  return from_json(read_file(path, std::size_t{64} << 20), path.string(), import);
}

MaterialDatabase MaterialDatabase::from_file(const std::filesystem::path& path, std::vector<MaterialWarning>* warnings) {
  return from_file(path, MaterialImport{.reading = std::nullopt, .warnings = warnings});
}

MaterialDatabase MaterialDatabase::builtin() { return from_json(builtin_json, "built-in materials"); }

const Material* MaterialDatabase::find(std::string_view name) const {
  const auto found = std::find_if(materials_.begin(), materials_.end(), [&](const Material& m) { return m.name == name; });
  return found == materials_.end() ? nullptr : &*found;
}

const Material& MaterialDatabase::get(std::string_view name, const std::string& where) const {
  if (const Material* found = find(name)) return *found;
  std::set<std::string> names;
  for (const Material& material : materials_) names.insert(material.name);
  const std::string nearest = nearest_word(name, names);
  throw InputError(
      where, "material '" + std::string(name) + "' is unknown",
      nearest.empty() ? fmt::format("the database has {} materials, see its file", names.size()) : "did you mean '" + nearest + "'?");
}

const Material* MaterialDatabase::find_by_substrings(std::string_view category) const {
  const std::string text = fold_case(category);
  const Material* best = nullptr;
  std::size_t most = 0;
  for (const Material& material : materials_) {
    std::size_t score = 0;
    for (const std::string& label : material.labels) score += !label.empty() && text.find(label) != std::string::npos ? 1 : 0;
    if (score > most) {
      most = score;
      best = &material;
    }
  }
  return best;
}

const Material* MaterialDatabase::find_label(std::string_view category) const {
  const std::string wanted = fold_case(category);
  for (const Material& material : materials_) {
    for (const std::string& label : material.labels) {
      if (fold_case(label) == wanted) return &material;
    }
  }
  return nullptr;
}

}  // namespace earshot
