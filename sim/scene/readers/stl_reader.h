// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "sim/scene/readers/mesh_part.h"

namespace earshot {

/// Number of triangles that the header of a binary STL promises; nullopt for a text.  Binary: the triangles fit into the file, or it holds
/// bytes that no text has; the word `solid` at its beginning decides nothing, many programs write it into binary headers.
std::optional<std::uint32_t> binary_stl_count(std::string_view bytes);

/// Reads an STL file.  One part per solid of a text, named by it, else `object`; keywords in any case; a missing endsolid is a doubt,
/// since a file that was cut off lacks it.  Colours of binary facets (VisCAM, Materialise) where looks are asked for.
/// Throws InputError naming `where`: a facet that is not whole, fewer triangles than a binary header promises, or more.
MeshFile parse_stl(std::string_view bytes, const std::string& where, const std::string& object, bool with_looks);

}  // namespace earshot
