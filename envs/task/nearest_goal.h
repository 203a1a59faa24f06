// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <glm/vec3.hpp>
#include <optional>

#include "envs/task/episode.h"
#include "sim/nav/geodesic_field.h"

namespace earshot {

/// The goals of an episode as one: distances and ways are those to the nearest.  Refers to the fields.
class NearestGoal {
 public:
  NearestGoal(const GeodesicField& field) { add(field); }  // NOLINT: one goal is the usual case
  /// At most kMaxGoals in all.
  void add(const GeodesicField& field) { fields_[count_++] = &field; }

  /// Metres along the navmesh; nothing where no goal can be reached.
  [[nodiscard]] std::optional<float> distance_m(glm::vec3 position) const {
    std::optional<float> least;
    for (std::size_t i = 0; i < count_; ++i) {
      const std::optional<float> distance = fields_[i]->distance_m(position);
      if (distance && (!least || *distance < *least)) least = distance;
    }
    return least;
  }
  /// Of the way to the goal that is nearest from `position`.
  [[nodiscard]] std::optional<glm::vec3> next_corner(glm::vec3 position) const { return nearest(position).next_corner(position); }
  [[nodiscard]] const GeodesicField& nearest(glm::vec3 position) const {
    std::size_t best = 0;
    std::optional<float> least;
    for (std::size_t i = 0; i < count_ && count_ > 1; ++i) {
      const std::optional<float> distance = fields_[i]->distance_m(position);
      if (distance && (!least || *distance < *least)) {
        least = distance;
        best = i;
      }
    }
    return *fields_[best];
  }

 private:
  std::array<const GeodesicField*, kMaxGoals> fields_{};
  std::size_t count_ = 0;
};

}  // namespace earshot
