// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/mat4x4.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/scene/readers/gltf_buffers.h"

namespace earshot {

/// Transform of a glTF node to its parent: `matrix`, or `translation`, `rotation` and `scale`.
glm::dmat4 gltf_node_to_parent(const nlohmann::json& node);

/// Transforms of the copies of a node's mesh, to the node (EXT_mesh_gpu_instancing); one identity without the extension.
/// Throws InputError naming `where` for attributes whose counts differ; nlohmann::json exceptions may pass.
std::vector<glm::dmat4> gltf_instances(const GltfAsset& asset, const nlohmann::json& node, const std::string& where);

/// Adds the morph targets of a primitive to its positions, each times its default weight: that of the node, else of the mesh, else zero
/// (glTF 2.0, section 3.7.2.2).  Throws as gltf_instances does, for numbers of weights and targets that differ too.
void apply_morph_targets(const GltfAsset& asset, const nlohmann::json& node, const nlohmann::json& mesh, const nlohmann::json& primitive,
                         const std::string& where, std::vector<glm::dvec3>& positions);

}  // namespace earshot
