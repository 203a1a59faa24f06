// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <optional>

#include "sim/nav/navmesh.h"

namespace earshot {

/// Length of a path through the polygons that Detour's search chooses, pulled taut: never shorter than the shortest path
/// (GeodesicField), mostly the same.  nullopt if there is none.  About 0.1 ms; allocates.
std::optional<double> corridor_length_m(const Navmesh& navmesh, glm::vec3 from, glm::vec3 to);

}  // namespace earshot
