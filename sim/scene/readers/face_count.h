// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

namespace earshot {

/// Faces of a mesh file, counted in its bytes apart from the readers: lines `f` of an OBJ, faces and strips that the header of a PLY
/// promises, facets of an STL (the number in a binary header, the word `facet` in a text).  One pass over the bytes; never throws.
std::uint64_t count_obj_faces(std::string_view bytes);
std::uint64_t count_ply_faces(std::string_view bytes);
std::uint64_t count_stl_faces(std::string_view bytes);

}  // namespace earshot
