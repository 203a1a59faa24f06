#pragma once

#include <filesystem>
#include <glm/mat4x4.hpp>

#include "sim/scene/mesh_builder.h"

namespace earshot {

/// Gives the builder the triangles of a .gltf or .glb file (glTF 2.0): default scene, node transforms, indexed and plain triangles, strips
/// and fans, sparse and quantized accessors, external, embedded and base64 buffers.  Objects are named by the node, else the mesh.
///
/// Not Assimp: release 5.2 refuses interleaved accessors whose last element ends before a whole stride (the layout of the
/// glTF specification), ignores quantized positions, and allocates the counts of a damaged file before it checks them against its size.
/// Throws InputError.  Compressed geometry (Draco, meshopt) is refused by name.
void read_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder);

}  // namespace earshot
