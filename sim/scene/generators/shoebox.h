// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "sim/scene/materials/materials.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// A box with a corner at the origin: 12 triangles, normals inward, one material slot per wall in the order x0, x1, y0 (floor), y1
/// (ceiling), z0, z1.  Objects wall_0, wall_1, floor_0, ceiling_0, wall_2, wall_3.
TriangleMesh make_shoebox(glm::vec3 size_m);

struct Shoebox {
  TriangleMesh mesh;
  std::vector<Material> material_of_slot;  ///< [6]
};

/// Reads `XxYxZ[@M]`, the text after `shoebox:`.  Sizes in metres, above 0.  M: one value for all walls, or six separated by commas in
/// the order of the slots; each a material name or an absorption in [0, 1], which takes its scattering from the default material and
/// transmits nothing.  Without M: the default material.  Throws InputError.
Shoebox parse_shoebox(std::string_view text, const MaterialDatabase& database);

}  // namespace earshot
