#pragma once

#include <glm/vec3.hpp>

#include "sim/scene/scene.h"

namespace earshot {

/// Tells points inside walls and furniture from points of the air (docs/stability.md, H-15).  Five rays vote: inside a solid the nearest
/// faces show the side that they turn away from the air.  Which side that is, points of the air say (air_sample.h), so rooms modelled as
/// shells and as the inside of boxes both work.  A scene whose windings are mixed tells nothing: then no point counts as inside.
class PositionCheck {
 public:
  /// Keeps a reference.  About 0.1 s for 150,000 triangles.
  explicit PositionCheck(const Scene& scene);
  /// Do four of the five rays say that the point lies in a solid?  Five rays.
  [[nodiscard]] bool inside_solid(glm::vec3 point) const;
  /// Do windings tell inside from outside here?
  [[nodiscard]] bool knows() const { return air_sees_front_ != air_sees_back_; }

 private:
  struct Votes {
    int front = 0, back = 0;
  };
  [[nodiscard]] Votes vote(glm::vec3 point) const;

  const Scene* scene_;
  bool air_sees_front_ = false, air_sees_back_ = false;
};

}  // namespace earshot
