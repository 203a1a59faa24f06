// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/scene/materials/material_lint.h"

namespace earshot {
namespace {

struct MaterialsArguments {
  std::string file, reading, json;
  bool only_lint = false;
};

constexpr std::array<float, 6> kOctavesHz{125, 250, 500, 1000, 2000, 4000};

void print_row(const Material& material, const char* key, const CoefficientCurve& curve) {
  fmt::print("  {:<13}", key);
  for (const float hz : kOctavesHz) fmt::print(" {:>7.3g}", curve.at(hz));
  fmt::print("  {}\n", material.source_of(key));
}

nlohmann::ordered_json json_of(const Material& material, const char* key, const CoefficientCurve& curve) {
  nlohmann::ordered_json values = nlohmann::ordered_json::array();
  for (const float hz : kOctavesHz) values.push_back(curve.at(hz));
  return {{"values", std::move(values)}, {"source", material.source_of(key)}};
}

std::string materials_json(const MaterialDatabase& database, const std::vector<MaterialWarning>& findings) {
  nlohmann::ordered_json materials = nlohmann::ordered_json::array(), lint = nlohmann::ordered_json::array();
  for (const Material& material : database.all())
    materials.push_back({{"name", material.name},
                         {"absorption", json_of(material, "absorption", material.absorption)},
                         {"scattering", json_of(material, "scattering", material.scattering)},
                         {"transmission", json_of(material, "transmission", material.transmission)}});
  for (const MaterialWarning& finding : findings) lint.push_back({{"material", finding.material}, {"text", finding.text}});
  return json_text(
             nlohmann::ordered_json{
                 {"schema_version", 1}, {"bands_hz", kOctavesHz}, {"materials", std::move(materials)}, {"findings", std::move(lint)}},
             2) +
         "\n";
}

void run_materials(const MaterialsArguments& options) {
  MaterialImport import{.reading = std::nullopt, .warnings = nullptr, .keep_transmission = true};
  if (options.reading == "energy") import.reading = CoefficientReading::energy;
  if (options.reading == "pressure") import.reading = CoefficientReading::pressure;
  const MaterialDatabase database = options.file.empty() ? MaterialDatabase::builtin() : MaterialDatabase::from_file(options.file, import);
  if (!options.only_lint) {
    fmt::print("{:<15} 125 Hz  250 Hz  500 Hz    1 kHz   2 kHz   4 kHz  source\n", "");
    for (const Material& material : database.all()) {
      fmt::print("{}\n", material.name);
      print_row(material, "absorption", material.absorption);
      print_row(material, "scattering", material.scattering);
      print_row(material, "transmission", material.transmission);
    }
  }
  const std::vector<MaterialWarning> findings = lint(database);
  for (const MaterialWarning& finding : findings)
    fmt::print("lint: {}{}{}\n", finding.material, finding.material.empty() ? "" : ": ", finding.text);
  if (!options.json.empty()) write_file_atomically(options.json, materials_json(database, findings));
  fmt::print("{} materials, {} findings\n", database.all().size(), findings.size());
  if (!findings.empty()) throw RunError(options.file, fmt::format("has {} findings, listed above", findings.size()));
}

}  // namespace

void add_materials(CLI::App& app) {
  auto options = std::make_shared<MaterialsArguments>();
  CLI::App* command =
      app.add_subcommand("materials", "Print a table of acoustic materials with their sources, and check it for likely mistakes");
  command->add_option("FILE", options->file, "Material database (JSON; default: the built-in database)");
  command
      ->add_option("--coefficients", options->reading,
                   "Quantity that the coefficients are fractions of (default: value of the file, else energy)")
      ->check(CLI::IsMember({"energy", "pressure"}));
  command->add_flag("--lint", options->only_lint,
                    "Print only the findings.  The exit code is 1 if there are any, with or without this flag");
  command->add_option("--json", options->json, "Also write the table and the findings to this JSON file")->type_name(kOutputFile);
  command->callback([options] { run_materials(*options); });
}

}  // namespace earshot
