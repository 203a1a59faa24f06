// SPDX-License-Identifier: Apache-2.0
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
#include "sim/scene/readers/surface_names.h"

namespace earshot {

/// A primitive of a mesh that hangs in the default scene; positions in its own frame, three corners per triangle.
struct GltfPrimitive {
  const GltfAsset& asset;
  const nlohmann::json& json;  ///< of the primitive
  std::string object, material;
  glm::dmat4 to_world{1};
  std::vector<glm::dvec3> positions;   ///< morph targets added with their default weights
  std::vector<std::uint32_t> corners;  ///< as the file has them: may point past the positions
};
/// Calls `visit` with each primitive that has positions, once per instance of its node.  Throws InputError, also for json exceptions and
/// std::out_of_range of `visit`.  Returns one line for each thing that was left out (gltf_extensions.h, primitives without positions).
std::vector<std::string> visit_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world,
                                    const std::function<void(const GltfPrimitive& primitive)>& visit);

/// Gives the builder the triangles of a .gltf or .glb file (glTF 2.0): default scene, node transforms, instances (EXT_mesh_gpu_instancing),
/// default weights of morph targets, indexed and plain triangles, strips and fans, sparse and quantized accessors, external, embedded and
/// base64 buffers.  Objects are named by the node, else the mesh.  Returns warnings as visit_gltf does.
/// names: of its surfaces, or null.
/// Throws InputError.  Extensions that are required and not known are refused by name, compressed geometry (Draco, meshopt) among them, and
/// so is a number of triangles that differs from what the accessors promise.
std::vector<std::string> read_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder,
                                   SurfaceNames* names = nullptr);

}  // namespace earshot
