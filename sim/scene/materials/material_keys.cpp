// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/material_keys.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::string_view kEntry = "materials[].", kSource = "materials[].source.";

ConfigKey declare(const std::string& name, KeyType type, const Allowed& allowed, About about) {
  return {.name = name, .type = type, .allowed = allowed, .about = std::string(about.text())};
}

ConfigKey declare_required(const std::string& name, KeyType type, const Allowed& allowed, About about) {
  ConfigKey key = declare(name, type, allowed, about);
  key.is_required = true;
  return key;
}

std::vector<ConfigKey> declare_all() {
  const std::string entry(kEntry);
  const Allowed fraction = Allowed::between(0, 1);
  ConfigKey version = declare("schema_version", KeyType::whole_number, Allowed::between(1, 1), "Version of the file format.");
  version.default_value = "1";
  ConfigKey reading =
      declare("coefficients", KeyType::choice, Allowed::any(), "Meaning of the numbers: fractions of the energy, or of the pressure.");
  reading.choices = {"energy", "pressure"};
  reading.default_value = "energy";
  ConfigKey angle = declare(entry + "angle", KeyType::choice, Allowed::any(),
                            "Specular reflection by the angle: the same at all (random), or as from a locally reacting surface.");
  angle.choices = {"random", "locally_reacting"};
  angle.default_value = "random";
  std::vector<ConfigKey> keys{
      version,
      reading,
      declare_required("materials[]", KeyType::section, Allowed::any(), "List of materials, with entries of these keys."),
      declare_required(entry + "name", KeyType::text, Allowed::any(), "Name, which no other material has."),
      declare(entry + "labels", KeyType::texts, Allowed::text("a label"), "Names of mesh materials or categories that it stands for."),
      declare(entry + "absorption", KeyType::numbers, fraction,
              "Absorption coefficient, transmitted energy included: [Hz, value, Hz, value, ...]. Required unless impedance is given, from "
              "which it then follows."),
      declare_required(entry + "scattering", KeyType::numbers, fraction,
                       "Fraction of the reflected energy that leaves diffusely: [Hz, value, ...]."),
      declare(entry + "transmission", KeyType::numbers, fraction,
              "Transmission coefficient, at most the absorption: [Hz, value, ...]. Absent: none."),
      declare(entry + "damping", KeyType::numbers, Allowed::between(0, 1e6), "Damping inside the material in dB/m: [Hz, value, ...]."),
      declare(entry + "speed", KeyType::number, Allowed::at_least(0), "Speed of sound in the material in m/s."),
      declare(entry + "density", KeyType::number, Allowed::at_least(0), "Density in kg/m3."),
      angle,
      declare(entry + "impedance", KeyType::numbers, Allowed::between(-1e6, 1e6),
              "Specific impedance of a locally reacting surface, over that of air: [Hz, real, imaginary, ...]. The real part is positive."),
      declare(entry + "source", KeyType::text, Allowed::text("text, or a map with a text for each key"), "Source of the numbers.")};
  for (const char* name : {"absorption", "scattering", "transmission", "damping", "speed", "density", "impedance"})
    keys.push_back(declare(std::string(kSource) + name, KeyType::text, Allowed::any(), "Source of the numbers of this key."));
  return keys;
}

std::set<std::string> names_under(std::string_view prefix) {
  std::set<std::string> names;
  for (const ConfigKey& key : material_database_keys()) {
    if (!key.name.starts_with(prefix)) continue;
    const std::string name = key.name.substr(prefix.size());
    if (name.find('.') == std::string::npos) names.insert(name);
  }
  return names;
}

}  // namespace

const std::vector<ConfigKey>& material_database_keys() {
  static const std::vector<ConfigKey> keys = declare_all();
  return keys;
}

const std::set<std::string>& material_entry_keys() {
  static const std::set<std::string> names = names_under(kEntry);
  return names;
}

const std::set<std::string>& material_source_keys() {
  static const std::set<std::string> names = names_under(kSource);
  return names;
}

const ConfigKey& material_entry_key(std::string_view name) {
  const auto& keys = material_database_keys();
  const auto found = std::ranges::find_if(keys, [&](const ConfigKey& key) { return key.name == std::string(kEntry) + std::string(name); });
  EARSHOT_EXPECT(found != keys.end());
  return *found;
}

}  // namespace earshot
