// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>

#include "sim/scene/scene.h"

namespace earshot {

/// Tells points inside walls and furniture from points of the air (docs/evidence/stability.md, H-15), by the side of the nearest faces that
/// five rays meet.  Which side of a face is the air is found from points of the air (air_sample.h), so rooms modelled as shells and as the
/// inside of boxes both work.  In a scene whose windings are mixed no point counts as inside.
class PositionCheck {
 public:
  /// Keeps a reference.  About 0.1 s for 150,000 triangles.
  explicit PositionCheck(const Scene& scene);
  /// Do four of five rays meet faces from inside the solid?
  [[nodiscard]] bool inside_solid(glm::vec3 point) const;
  /// Are windings consistent, so that inside and outside can be told apart?
  [[nodiscard]] bool has_consistent_windings() const { return air_meets_front_ != air_meets_back_; }

 private:
  struct FaceCounts {
    int front = 0, back = 0;
  };
  [[nodiscard]] FaceCounts count_faces(glm::vec3 point) const;

  const Scene* scene_;
  bool air_meets_front_ = false, air_meets_back_ = false;
};

}  // namespace earshot
