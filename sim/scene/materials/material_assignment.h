// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "sim/scene/materials/materials.h"
#include "sim/scene/materials/semantic_materials.h"
#include "sim/scene/mesh/import_report.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// How the labels of the database are compared with names of the mesh.
enum class LabelMatching {
  exact,             ///< as whole words
  legacy_substring,  ///< as the predecessor does: MaterialDatabase::find_by_substrings
};

/// Materials of a scene: (pattern, name of a material in the database), in file order.
struct MaterialRules {
  std::vector<std::pair<std::string, std::string>> assign;
  std::string default_material;                                  ///< empty: see below
  std::shared_ptr<const SemanticMaterials> semantics = nullptr;  ///< null: categories play no part
  LabelMatching label_matching = LabelMatching::exact;
  bool own_first = false;  ///< step 6 before step 5: the slots' own materials are what the user wrote (shoebox:...@M)
};

/// One Material per slot of the mesh.  For a triangle, the first of these that applies:
///   1. a pattern equal to its mesh-material name,   2. a pattern equal to its node name,
///   3. a glob (* and ?) on the mesh-material name,  4. a glob on the node name   (each in file order; case counts),
///   5. the first candidate of the semantic category of its mesh-material name, else of its node name, if `semantics` are given,
///   6. `slot_materials`, the material that the slot came with (shoebox and house),
///   7. `default_material` if it is named,
///   8. the database entry whose name or else label equals the mesh-material name, or a '/'-separated component of it, case-folded; with
///      legacy_substring, the entry with the most labels inside the mesh-material name, else inside the node name,
///   9. the entry labelled "default".
/// Node names may give one slot several materials or categories: such slots are split, the new ones are called "slot (material)" or
/// "slot (category)".  A material that a category chose carries its name (Material::category).
/// Patterns that match nothing are appended to `warnings`.  Throws InputError for a material that the database lacks.
/// where: the file that the rules come from, for messages.  choices: of each slot, appended, if not null.
std::vector<Material> assign_materials(TriangleMesh& mesh, const MaterialRules& rules, const MaterialDatabase& database,
                                       const std::vector<std::optional<Material>>& slot_materials, const std::string& where,
                                       std::vector<std::string>& warnings, std::vector<MaterialChoice>* choices = nullptr);

}  // namespace earshot
