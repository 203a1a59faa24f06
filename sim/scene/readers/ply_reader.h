// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/readers/mesh_part.h"

namespace earshot {

/// Reads a PLY file, text or binary: the element `vertex` (x, y, z of any type, and colours where looks are asked for), the element `face`
/// (list vertex_indices or vertex_index) and the element `tristrips` (strips of triangles, -1 begins the next one).  The property
/// object_id or face_segment of a face, of an integer type, is its number.  One part, named
/// `object`.  What the header promises and what the body holds must agree: a body that is too short, and text behind a body, are refused;
/// bytes behind a binary body, and elements of other names that hold faces, are named in a warning.
/// Throws InputError naming `where`.
MeshFile parse_ply(std::string_view bytes, const std::string& where, const std::string& object, bool with_looks);

}  // namespace earshot
