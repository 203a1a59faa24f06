// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "sim/scene/scene.h"
#include "sim/scene/scene_report.h"

namespace earshot {

/// What may not be meant about a scene, one line each, for every command that takes one: the warnings of its import; of a scene from a mesh
/// file also rays that leave it (1 to 45 %: holes, or no ceiling; more is open country), next to no air inside, surfaces that take the
/// default material because nothing names another, categories that match nothing, and a unit or an up axis that the mesh speaks against
/// (axes_guess.h) where none was given.
///
/// Costs as report_scene, about 0.2 s for 150,000 triangles; nothing for generated scenes.
std::vector<std::string> scene_warnings(const Scene& scene);
/// The same with the report of this scene.
std::vector<std::string> scene_warnings(const Scene& scene, const SceneReport& report);

/// Why a slot of the mesh has its material, as a phrase: "assign.Wall*", "category wall", "default: nothing names a material".
std::string reason_of(const MaterialChoice& choice);

/// Area of each material slot of the mesh, m2.
std::vector<double> slot_areas(const Scene& scene);

}  // namespace earshot
