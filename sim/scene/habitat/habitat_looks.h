// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "sim/scene/visual_mesh.h"

namespace earshot {

/// A scene of Habitat (habitat_scene.h) as it looks: its mesh files, each read once, at their places.  Colours come from its triangles, as
/// mesh files may give one name to several colours.  Throws InputError as read_habitat_scene and read_visual_mesh do.
VisualMesh read_habitat_looks(const std::string& spec, glm::dvec3 origin_m, int largest_texture_px);

}  // namespace earshot
