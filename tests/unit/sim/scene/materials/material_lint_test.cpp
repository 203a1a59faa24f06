// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/material_lint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// Findings as "material: text".
std::vector<std::string> findings_of(const std::string& json) {
  std::vector<std::string> lines;
  for (const MaterialWarning& finding : lint(MaterialDatabase::from_json(json, "db", MaterialImport{.keep_transmission = true}))) {
    lines.push_back(finding.material + ": " + finding.text);
  }
  return lines;
}

/// One plain material called felt, with keys of the entry replaced or added.
std::vector<std::string> findings_with(const std::string& key, const std::string& value) {
  nlohmann::json entry = {{"name", "felt"},
                          {"labels", {"default"}},
                          {"absorption", {125, 0.2, 250, 0.3, 500, 0.4}},
                          {"scattering", {125, 0.1, 250, 0.2, 500, 0.3}},
                          {"transmission", {125, 0.01, 250, 0.002, 500, 0.001}},
                          {"source", "a book"}};
  entry[key] = parse_json(value);
  std::vector<std::string> lines = findings_of(json_text(nlohmann::json{{"materials", {entry}}}));
  std::erase_if(lines, [](const std::string& line) { return line.find("is named or labelled") != std::string::npos; });
  return lines;
}

TEST(MaterialLint, BuiltinDatabaseIsClean) {
  for (const MaterialWarning& finding : lint(MaterialDatabase::builtin())) ADD_FAILURE() << finding.material << ": " << finding.text;
}

TEST(MaterialLint, APlainMaterialIsClean) { EXPECT_THAT(findings_with("speed", "340"), IsEmpty()); }

TEST(MaterialLint, FindsEachKindOfFault) {
  EXPECT_THAT(findings_with("source", R"("")"), Contains("felt: absorption has no source"));
  EXPECT_THAT(findings_with("source", R"({"absorption": "a", "scattering": "b"})"), Contains("felt: transmission has no source").Times(0))
      << "the joined text stands for the rest";
  EXPECT_THAT(findings_with("transmission", "[125, 0.1, 250, 0.35, 500, 0.1]"),
              Contains("felt: transmission 0.35 exceeds the absorption 0.3 at 250 Hz"));
  EXPECT_THAT(findings_with("absorption", "[125, 0.02, 250, 0.3, 500, 0.4]"), Contains(HasSubstr("absorption steps from 0.02 at 125 Hz")));
  EXPECT_THAT(findings_with("transmission", "[125, 0.1, 250, 0.0009, 500, 0.0009]"), Contains(HasSubstr("transmission steps")));
  EXPECT_THAT(findings_with("transmission", "[125, 0.1, 250, 0.005, 500, 0.003]"), IsEmpty()) << "13 dB an octave occurs in drywall";
  EXPECT_THAT(findings_with("scattering", "[125, 0.5, 4000, 0.5]"), Contains(HasSubstr("scattering is 0.5 at all frequencies")));
  EXPECT_THAT(findings_with("labels", R"(["default", "rug", "Rug"])"), Contains(HasSubstr("'Rug' occurs twice")));
  EXPECT_THAT(findings_with("labels", R"(["rug"])"), Contains(": no material is labelled 'default'"));
  EXPECT_THAT(findings_with("labels", R"(["default", "piperefrigerator"])"), Contains(HasSubstr("'pipe' and 'refrigerator' joined")));
  EXPECT_THAT(findings_with("labels", R"(["default", "bookcase"])"), IsEmpty()) << "a word of its own";
}

TEST(MaterialLint, FindsFaultsBetweenMaterials) {
  const std::string rest = R"("absorption": [125, 0.2, 250, 0.3, 500, 0.4], "scattering": [125, 0.1, 250, 0.2, 500, 0.3])";
  const std::vector<std::string> lines = findings_of(R"({"materials": [
    {"name": "brick", "labels": ["default"], )" + rest +
                                                     R"(, "transmission": [125, 0.02, 250, 0.01, 500, 0.0089]},
    {"name": "plaster", "labels": ["brick"], )" + rest +
                                                     R"(, "transmission": [125, 0.02, 250, 0.01, 500, 0.00089]},
    {"name": "b", )" + rest + R"(, "transmission": [125, 0.02, 250, 0.01, 500, 0.0089]},
    {"name": "c", )" + rest + R"(, "transmission": [125, 0.02, 250, 0.01, 500, 0.0089]}]})");
  EXPECT_THAT(
      lines,
      Contains("plaster: transmission equals that of 'brick' except for 0.00089 instead of 0.0089 at 500 Hz; check the decimal point"));
  EXPECT_THAT(lines, Contains("plaster: label 'brick' is the name of another material"));
  EXPECT_THAT(lines, Contains(": 'brick', 'b', 'c' have the same transmission and no source"));
  EXPECT_THAT(lines, Contains(": no material is named or labelled 'wall'"));
  EXPECT_THAT(lines, Not(Contains(HasSubstr("'default'"))));
}

/// The predecessor's table (its published material map), in the layout of its JSON, with the faulty labels that docs/reference/formats.md,
/// section 2 lists.
std::string predecessor_json(const std::filesystem::path& path) {
  const nlohmann::json table = parse_json(read_file(path));
  nlohmann::json materials = nlohmann::json::array();
  for (const auto& [name, curves] : table["materials"].items()) {
    nlohmann::json entry = {{"name", name}};
    for (const char* key : {"absorption", "scattering", "transmission"}) {
      for (const auto& point : curves[key]) {
        entry[key].push_back(point[0] == 0 ? nlohmann::json(20) : point[0]);
        entry[key].push_back(point[1]);
      }
    }
    entry["damping"] = {22.28, 1.16e-10, 17953.7, 7.5e-5};
    entry["speed"] = 1483.96;
    entry["density"] = 998.65;
    if (name == "default") entry["labels"] = {"default"};
    if (name == "carpet") entry["labels"] = {"floor", "mat", "floor"};
    if (name == "steel") entry["labels"] = {"sink", "piperefrigerator"};
    if (name == "gypsumBoard") entry["labels"] = {"wall"};
    materials.push_back(entry);
  }
  return json_text(nlohmann::json{{"materials", materials}});
}

// docs/reference/formats.md, section 2.
TEST(MaterialLint, FindsThePredecessorsFaults) {
  SKIP_WITHOUT_DATA("materials/soundspaces_materials.json");
  const std::filesystem::path path = data_folder() / "materials/soundspaces_materials.json";
  const std::vector<std::string> lines = findings_of(predecessor_json(path));
  for (const char* finding : {
           "plasterOnBrick: transmission equals that of 'brick' except for 0.00089 instead of 0.0089 at 4000 Hz; check the decimal point",
           "plasterOnConcreteBlock: transmission equals that of 'concreteBlock' except for 0.00011 instead of 0.0011 at 2000 Hz; check the "
           "decimal point",
           "plasterOnConcreteBlock: transmission steps from 0.0035 at 1000 Hz to 0.00011 at 2000 Hz",
           "foliage: transmission 0.9 exceeds the absorption 0.03 at 125 Hz",
           "steel: transmission 0.25 exceeds the absorption 0.05 at 125 Hz",
           "steel: label 'piperefrigerator' looks like 'pipe' and 'refrigerator' joined",
           "carpet: label 'floor' occurs twice, first on 'carpet'",
           "soundProof: absorption is 1 at all frequencies, which looks like a placeholder",
           "soundProof: scattering is 0 at all frequencies, which looks like a placeholder",
           "brick: absorption has no source",
       }) {
    EXPECT_THAT(lines, Contains(finding));
  }
  EXPECT_THAT(lines, Contains(HasSubstr("'carpet', 'carpetHeavy', 'carpetHeavyPadded', 'ceramicTile', 'concrete', 'concreteRough', "
                                        "'woodOnConcrete' have the same transmission")));
}

// The predecessor's layout loads, flat arrays, water's speed and all; what exceeds its absorption is lowered and reported.
TEST(MaterialLint, PredecessorsLayoutLoads) {
  SKIP_WITHOUT_DATA("materials/soundspaces_materials.json");
  const std::filesystem::path path = data_folder() / "materials/soundspaces_materials.json";
  std::vector<MaterialWarning> warnings;
  const MaterialDatabase database = MaterialDatabase::from_json(predecessor_json(path), "predecessor", &warnings);
  EXPECT_EQ(database.all().size(), 30u);
  EXPECT_FALSE(warnings.empty());
  const Material& steel = database.get("steel", "");
  EXPECT_FLOAT_EQ(steel.transmission.at(125), 0.05f);
  EXPECT_FLOAT_EQ(steel.speed_m_per_s, 1483.96f);
  EXPECT_FLOAT_EQ(database.get("acousticTile", "").absorption.at(250), 0.7f);
  EXPECT_EQ(database.find_by_substrings("refrigerator"), nullptr) << "the fused label: the predecessor's refrigerators are default";
}

}  // namespace
}  // namespace earshot
