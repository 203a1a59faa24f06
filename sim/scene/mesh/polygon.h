// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace earshot {

/// Cuts a simple polygon, nearly flat, into size - 2 triangles by clipping ears (Meisters 1975); concave ones too.
/// corners: positions in order.  Appends three indices into `corners` per triangle, winding kept; nothing for fewer than three corners.
/// A polygon that crosses itself comes out as a fan where no ear is left.  O(n^2) for convex, O(n^3) at worst: n is bounded by
/// largest_polygon.
void triangulate_polygon(std::span<const glm::vec3> corners, std::vector<std::uint32_t>& indices);

inline constexpr std::size_t largest_polygon = 1024;

}  // namespace earshot
