// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec2.hpp>
#include <vector>

namespace earshot {

/// A triangulated patch of a plane, counterclockwise.
struct FlatPatch {
  std::vector<glm::dvec2> vertices;                     ///< in the plane, metres
  std::vector<bool> is_border;                          ///< per vertex: stays
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< of vertices
};

/// Takes out vertices that are not on the border, one by one: the hole is filled with a fan from that neighbour which makes the least
/// narrow triangles, if none is narrower than 1 : 100.  Every fan covers its hole exactly once.  Deterministic; about 1 us per vertex and
/// pass, a handful of passes.
void collapse_inner_vertices(FlatPatch& patch);

}  // namespace earshot
