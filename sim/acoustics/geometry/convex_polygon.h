// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/mirror_planes.h"

namespace earshot {

/// Vertices of a convex polygon in a plane, in order round it; none: empty.
using ConvexPolygon = std::vector<glm::dvec3>;

/// The part of a mirror plane that lies within its bounds: all of its triangles, and more where they do not fill them.
ConvexPolygon polygon_of(const MirrorPlane& plane);

/// The part of `polygon` for which dot(normal, x) >= offset_m (Sutherland and Hodgman 1974).
ConvexPolygon clipped(const ConvexPolygon& polygon, glm::dvec3 normal, double offset_m);

/// The part of `polygon` that a beam from `apex` through `aperture` lights, behind the aperture and before it alike.
ConvexPolygon lit_part(const ConvexPolygon& polygon, glm::dvec3 apex, const ConvexPolygon& aperture);

}  // namespace earshot
