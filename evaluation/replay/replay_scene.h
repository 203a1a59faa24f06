// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "envs/scenes/env_scene.h"

namespace earshot {

/// The storey of a scene as a page shows it: cut open below the ceiling, in few triangles, without textures.
struct ReplayMesh {
  std::vector<glm::vec3> vertices;
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint8_t> colors;  ///< [triangles, 3] encoded sRGB
};

/// floor_m: height of the storey's floor.  Ceilings and what hangs from them are left out, and storeys above.  The surface is simplified
/// (mesh_simplify.h) by as much as it takes to come to max_triangles; where 1 m does not do, the largest triangles stay.
ReplayMesh replay_mesh(const Scene& scene, const Appearance& looks, float floor_m, std::size_t max_triangles = 24000);

/// A picture of a storey from above.
struct ReplayMap {
  int width_px = 0, height_px = 0;
  glm::vec2 low{0};  ///< x and z of its upper left corner; x to the right, z downwards
  float metres_per_px = 0;
  std::vector<std::uint8_t> rgb;  ///< [height, width, 3]
};

/// Drawn by rays from below the ceiling down, lit as cameras are; floor that is not walkable is darker, the inside of walls is dark.
ReplayMap replay_map(const EnvScene& scene, const Appearance& looks, float floor_m);

}  // namespace earshot
