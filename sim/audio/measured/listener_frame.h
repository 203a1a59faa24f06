// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

namespace earshot {

/// A triplet of a SOFA file in metres: as it is, or from azimuth (counter-clockwise from x), elevation (both in degrees) and radius.
glm::dvec3 sofa_position(glm::dvec3 value, bool is_spherical);

/// Axes of a listener in the room of a SOFA file (x front, y left, z up): where its head is and where it looks.
class ListenerFrame {
 public:
  /// view, up: any length but 0; `up` counts by its part across `view`, and is replaced if it has none.  Throws nothing: a view of length 0
  /// or of no number gives a frame that is not finite.
  ListenerFrame(glm::dvec3 position_m, glm::dvec3 view, glm::dvec3 up);
  /// From the head's centre to a point of the room, in head axes: x right, y up, -z front.  Metres.
  [[nodiscard]] glm::dvec3 to_head(glm::dvec3 point_m) const { return to_head_ * (point_m - position_m_); }

 private:
  glm::dvec3 position_m_;
  glm::dmat3 to_head_{1};
};

}  // namespace earshot
