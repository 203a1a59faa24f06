#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "sim/scene/materials.h"
#include "sim/scene/triangle_mesh.h"

namespace earshot {

/// Who gets which material: (pattern, name of a material in the database), in file order.
struct MaterialRules {
  std::vector<std::pair<std::string, std::string>> assign;
  std::string default_material;  ///< empty: see below
};

/// One Material per slot of the mesh.  For a triangle, the first of these that answers:
///   1. a pattern equal to its mesh-material name,   2. a pattern equal to its node name,
///   3. a glob (* and ?) on the mesh-material name,  4. a glob on the node name   (each in file order; case counts),
///   5. `own`, the material that the slot came with (shoebox and house),
///   6. `default_material` if it is named,
///   7. the database entry whose name or else label equals the mesh-material name, or a '/'-separated component of it, case-folded,
///   8. the entry labelled "default".
/// Node names may give one slot several materials: such slots are split, the new ones are called "slot (material)".
/// Patterns that match nothing are appended to `warnings`.  Throws InputError for a material that the database lacks.
/// where: the file that the rules come from, for messages.
std::vector<Material> assign_materials(TriangleMesh& mesh, const MaterialRules& rules, const MaterialDatabase& database,
                                       const std::vector<std::optional<Material>>& own, const std::string& where,
                                       std::vector<std::string>& warnings);

}  // namespace earshot
