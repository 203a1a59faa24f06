// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace earshot {

/// Checks that nothing in a glTF file asks for more than the reader knows: asset.minVersion above 2.0 and extensionsRequired that are not
/// known, compressed geometry among them, are refused by name.
/// Returns a line for each extension that is not known and stands where geometry is (nodes, meshes, accessors, buffers, the file itself):
/// it may change the geometry, and is left out.  Extensions of materials and textures change no geometry.
/// json: of the file.  Throws InputError naming `where`; nlohmann::json exceptions may pass.
std::vector<std::string> check_gltf_extensions(const nlohmann::json& json, const std::string& where);

}  // namespace earshot
