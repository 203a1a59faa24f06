// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "sim/scene/annotations/annotation_files.h"
#include "sim/scene/readers/mesh_import.h"

namespace earshot {

/// import_mesh, with the categories that a file beside the mesh gives its surfaces (annotation_files.h): they become the mesh materials,
/// and "CATEGORY_ID" the nodes.  A mesh that carries neither numbers nor colours takes them from the annotated mesh of the same place.
/// annotations: the file, where the user names one.
/// The report has one line for the fraction of the area without a category, and one for annotations that are missing or not read.
/// Throws InputError as import_mesh does, for a damaged file of annotations, and for a named one that no surface can be found for.
ImportedMesh import_annotated_mesh(const std::filesystem::path& mesh, const MeshImportOptions& options,
                                   const std::optional<std::filesystem::path>& annotations);

/// The same with annotations that a data set names for the mesh, which carries their numbers or colours itself or takes them from
/// files.carrier.  Where the mesh itself should carry them and has none, it is read as without.
ImportedMesh import_annotated_mesh(const std::filesystem::path& mesh, const MeshImportOptions& options, const AnnotationFiles& files);

}  // namespace earshot
