// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/scene/readers/mesh_part.h"

namespace earshot {

/// Reads an OBJ, PLY or STL file (by its extension, in any case) with the reader of its format; a UTF-8 byte order mark goes.
/// with_looks: colours, texture coordinates and, of an OBJ, its material libraries too.
/// Throws InputError naming the file: what the reader refuses, and a number of faces that differs from that counted in the bytes
/// (face_count.h): a reader must not lose a face in silence.  About 0.1 s per 100,000 triangles.
MeshFile read_mesh_file(const std::filesystem::path& path, bool with_looks = false);

}  // namespace earshot
