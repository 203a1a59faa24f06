// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <span>

namespace earshot {

inline constexpr int kMaxAmbisonicOrder = 9;

/// Real spherical harmonics, ACN order, N3D: order n needs (n + 1)^2 values, sum of squares (n + 1)^2 for every direction
/// (docs/evidence/oracles.md, O-28). direction: unit, world axes (x right, y up, -z front); ambisonic axes are (x, y, z) = (-z_w, -x_w,
/// y_w).  order in [0, kMaxAmbisonicOrder].
void spherical_harmonics_n3d(glm::vec3 direction, int order, std::span<float> values);
/// N3D -> SN3D factor of ACN channel `acn`: 1 / sqrt(2 l + 1).
float sn3d_from_n3d(int acn);
/// World direction seen by a head turned by heading_rad (counter-clockwise from above): components along right, up, back.
glm::vec3 to_head_axes(glm::vec3 world, double heading_rad);
/// Rotates coefficients [(order + 1)^2] of a world-axes field into the axes of a head turned by heading_rad, in place: turning left by 90
/// degrees moves a front source to the right.  Rotation about the vertical axis only mixes (l, m) with (l, -m).
void rotate_to_heading(std::span<float> coefficients, int order, double heading_rad);

}  // namespace earshot
