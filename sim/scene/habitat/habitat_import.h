// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "sim/scene/readers/mesh_import.h"

namespace earshot {

/// A scene of Habitat (habitat_scene.h) as one mesh in metres, y up: the stage, then the objects in the order of the scene, each mesh file
/// read once.  The stage keeps its names or takes its categories, as import_annotated_mesh gives them.  An object is one node; where the
/// descriptor has a class for its semantic_id that is its mesh material and "CLASS_NUMBER" its node, else its own materials stay and
/// "TEMPLATE_NUMBER" is its node.
/// The report has the warnings of the JSON files and the meshes, and one line for the area of objects without a class.
/// Throws InputError as read_habitat_scene and import_mesh do.
ImportedMesh import_habitat_scene(const std::string& spec);

}  // namespace earshot
