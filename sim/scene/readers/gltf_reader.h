#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/scene/readers/gltf_buffers.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {

/// A primitive of a mesh that hangs in the default scene; positions in its own frame, three corners per triangle.
struct GltfPrimitive {
  const GltfAsset& asset;
  const nlohmann::json& json;  ///< of the primitive
  std::string object, material;
  glm::dmat4 to_world{1};
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> corners;  ///< as the file has them: may point past the positions
};
/// Calls `visit` with each primitive that has positions.  Throws InputError, also for json exceptions and std::out_of_range of `visit`.
void visit_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world,
                const std::function<void(const GltfPrimitive& primitive)>& visit);

/// Gives the builder the triangles of a .gltf or .glb file (glTF 2.0): default scene, node transforms, indexed and plain triangles, strips
/// and fans, sparse and quantized accessors, external, embedded and base64 buffers.  Objects are named by the node, else the mesh.
///
/// Not Assimp: release 5.2 refuses interleaved accessors whose last element ends before a whole stride (the layout of the
/// glTF specification), ignores quantized positions, and allocates the counts of a damaged file before it checks them against its size.
/// Throws InputError.  Compressed geometry (Draco, meshopt) is refused by name.
void read_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder);

}  // namespace earshot
