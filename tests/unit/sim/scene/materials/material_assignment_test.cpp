// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/material_assignment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// One triangle per (material, node) pair.
TriangleMesh mesh_of(const std::vector<std::pair<std::string, std::string>>& triangles) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  for (const auto& [material, node] : triangles) {
    mesh.triangles.emplace_back(0, 1, 2);
    mesh.triangle_material.push_back(intern(mesh.material_names, material));
    mesh.triangle_object.push_back(intern(mesh.object_names, node));
  }
  return mesh;
}

struct Assigned {
  TriangleMesh mesh;
  std::vector<Material> materials;
  std::vector<std::string> warnings;
  /// Name of the material of each triangle.
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> result;
    for (const std::uint32_t slot : mesh.triangle_material) result.push_back(materials[slot].name);
    return result;
  }
};

Assigned assign(TriangleMesh mesh, const MaterialRules& rules, const std::vector<std::optional<Material>>& slot_materials = {}) {
  Assigned result{std::move(mesh), {}, {}};
  result.materials = assign_materials(result.mesh, rules, MaterialDatabase::builtin(), slot_materials, "s.yaml", result.warnings);
  EXPECT_EQ(result.materials.size(), result.mesh.material_names.size());
  return result;
}

TEST(AssignMaterials, PrecedenceIsExactMaterialExactNodeGlobMaterialGlobNode) {
  const TriangleMesh mesh = mesh_of({{"paint", "wall_1"}});
  const std::pair<std::string, std::string> exact_material{"paint", "marble"}, exact_node{"wall_1", "grass"},
      glob_material{"pai*", "linoleum"}, glob_node{"wall_?", "water"};
  EXPECT_THAT(assign(mesh, {{glob_node, glob_material, exact_node, exact_material}, ""}).names(), ElementsAre("marble"));
  EXPECT_THAT(assign(mesh, {{glob_node, glob_material, exact_node}, ""}).names(), ElementsAre("grass"));
  EXPECT_THAT(assign(mesh, {{glob_node, glob_material}, ""}).names(), ElementsAre("linoleum"));
  EXPECT_THAT(assign(mesh, {{glob_node}, ""}).names(), ElementsAre("water"));
}

TEST(AssignMaterials, FirstMatchInFileOrderWins) {
  const TriangleMesh mesh = mesh_of({{"CoffeeTable/M", "a"}, {"Tablet/M", "a"}});
  EXPECT_THAT(assign(mesh, {{{"Tablet*", "tv_glass"}, {"*Table*", "wood_furniture"}}, ""}).names(),
              ElementsAre("wood_furniture", "tv_glass"));
  EXPECT_THAT(assign(mesh, {{{"*Table*", "wood_furniture"}, {"Tablet*", "tv_glass"}}, ""}).names(),
              ElementsAre("wood_furniture", "wood_furniture"));
}

TEST(AssignMaterials, NodesSplitSlots) {
  const Assigned result = assign(mesh_of({{"paint", "wall"}, {"paint", "table"}, {"paint", "wall"}, {"metal", "table"}}),
                                 {{{"table", "wood_furniture"}}, "linoleum"});
  EXPECT_THAT(result.names(), ElementsAre("linoleum", "wood_furniture", "linoleum", "wood_furniture"));
  EXPECT_THAT(result.mesh.material_names, ElementsAre("paint", "paint (wood_furniture)", "metal"));
}

// Whole names, labels and '/'-separated components, case-folded; never parts of words.
TEST(AssignMaterials, NamesAndLabelsAnswerWithoutRules) {
  const Assigned result = assign(mesh_of({{"MARBLE", "n"},
                                          {"Wall", "n"},
                                          {"Bed/Material #3", "n"},
                                          {"room/kitchen/Rug", "n"},
                                          {"vegetable", "n"},
                                          {"Walls", "n"},
                                          {"", "n"}}),
                                 {});
  EXPECT_THAT(result.names(), ElementsAre("marble", "gypsum_board", "upholstery", "rug_heavy", "default", "default", "default"));
  EXPECT_THAT(result.warnings, IsEmpty());
}

TEST(AssignMaterials, DefaultMaterialTakesWhatNoPatternMatches) {
  EXPECT_THAT(assign(mesh_of({{"marble", "n"}, {"x", "n"}}), {{{"x", "linoleum"}}, "water"}).names(), ElementsAre("water", "linoleum"));
}

TEST(AssignMaterials, OwnMaterialsStayUnlessAPatternNamesThem) {
  const std::vector<std::optional<Material>> slot_materials{Material::uniform("mine", 0.3f, 1), Material::uniform("yours", 0.4f, 1)};
  EXPECT_THAT(assign(mesh_of({{"x0", "n"}, {"x1", "n"}}), {{{"x1", "linoleum"}}, "water"}, slot_materials).names(),
              ElementsAre("mine", "linoleum"));
}

TEST(AssignMaterials, WarnsAboutPatternsWithoutAMatch) {
  const Assigned result = assign(mesh_of({{"paint", "wall_1"}}), {{{"Wall*", "linoleum"}, {"paint", "linoleum"}, {"wall_*", "water"}}, ""});
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("Wall*"))) << "case counts; an overruled pattern still matched";
}

TEST(AssignMaterials, UnknownMaterialsAreErrorsWithASuggestion) {
  EXPECT_THAT(message_of<InputError>([] {
                assign(mesh_of({{"a", "n"}}), {{{"zzz*", "marbel"}}, ""});
              }),
              testing::AllOf(HasSubstr("s.yaml"), HasSubstr("zzz*"), HasSubstr("'marble'")));
  EXPECT_THAT(message_of<InputError>([] { assign(mesh_of({{"a", "n"}}), {{}, "marbel"}); }), HasSubstr("default_material"));
}

TEST(AssignMaterials, NeedsADefaultOnlyWhereNothingElseAnswers) {
  const MaterialDatabase bare =
      MaterialDatabase::from_json(R"({"materials": [{"name": "felt", "absorption": [125, 0.2], "scattering": [125, 0]}]})", "db");
  std::vector<std::string> warnings;
  TriangleMesh mesh = mesh_of({{"felt", "n"}});
  EXPECT_NO_THROW(assign_materials(mesh, {}, bare, {}, "s", warnings));
  mesh = mesh_of({{"other", "n"}});
  EXPECT_THROW(assign_materials(mesh, {}, bare, {}, "s", warnings), InputError);
}

}  // namespace
}  // namespace earshot
