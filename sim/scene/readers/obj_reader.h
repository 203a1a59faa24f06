// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/readers/mesh_part.h"

namespace earshot {

/// What parse_obj reads beside the geometry.
struct ObjOptions {
  bool with_looks = false;                       ///< texture coordinates and colours of vertices
  std::string default_object = "defaultobject";  ///< of faces before the first `o` or `g`
};

/// Reads a Wavefront OBJ: v (with a divisor or colours behind it), vt, f with any of v, v/vt, v//vn and v/vt/vn, relative indices, o, g,
/// usemtl.  A part is a run of faces of one object and one material.  Comments may stand behind data, a backslash continues a line.
///
/// Refuses every face and vertex line that it does not understand whole, free-form surfaces, and a file that ends within a line: a last
/// line without a line break is accepted if it is a complete face and every vertex before it is used, as a doubt.  Warns about
/// trailing vertices that no face uses (a file that was cut off between two faces has such), and about unknown keywords.
/// Throws InputError naming `where` and the line.
MeshFile parse_obj(std::string_view bytes, const std::string& where, const ObjOptions& options = {});

}  // namespace earshot
