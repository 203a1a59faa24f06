// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sim/scene/annotations/annotations.h"

namespace earshot {

/// The files that give the surfaces of a mesh their categories.
struct AnnotationFiles {
  std::filesystem::path names;    ///< categories by number or colour
  std::filesystem::path carrier;  ///< mesh whose surfaces carry these: the mesh itself, or another one of the same place
};

/// Pairs that belong to a mesh by the names that data sets ship, the first one first, whether they exist or not.  Of Matterport3D
/// X.house with X_semantic.ply, X.ply or X.glb; of HM3D X.semantic.txt with X.semantic.glb or X.basis.glb; of Replica info_semantic.json
/// with the PLY beside it, or with the mesh.ply a folder above.  Empty for other formats.
std::vector<AnnotationFiles> possible_annotations(const std::filesystem::path& mesh);

/// The possible pairs of which both files exist.
std::vector<AnnotationFiles> present_annotations(const std::filesystem::path& mesh);

/// The mesh beside a file of annotations whose surfaces carry its numbers or colours, by the names that data sets ship.
std::filesystem::path carrier_beside(const std::filesystem::path& names);

/// Files beside the mesh that look like annotations and are not read, as lines: a part of a pair without the other, and Gibson's .scn.
std::vector<std::string> unread_annotations(const std::filesystem::path& mesh);

/// Reads a file of annotations, its format by its name: .house, .json or .txt, up to 256 MiB.  Throws InputError: missing, too large,
/// damaged, another format.
Annotations read_annotations(const std::filesystem::path& path);

}  // namespace earshot
