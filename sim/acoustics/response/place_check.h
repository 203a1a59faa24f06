// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/position_check.h"
#include "sim/scene/checks/air_connection.h"

namespace earshot {

/// A source or a listener, and what messages call it.
struct NamedPlace {
  std::string_view name;  ///< for example "source"
  glm::vec3 position{0};  ///< in local coordinates
};

/// Finds places of sources and listeners that cannot be meant, before a response is computed.  Safe from any thread.
class PlaceCheck {
 public:
  /// Keeps a reference.  Costs nothing until something is odd.
  explicit PlaceCheck(const AcousticScene& acoustics) : acoustics_(acoustics) {}

  /// Throws InputError where no sound can get from one place to the other and one of them lies outside of surfaces that are closed around
  /// the other: wrong coordinates, unit or axis.  Otherwise what may be wrong, one line each: a place outside that may hear through walls
  /// alone, two places outside a closed room.  A position inside a solid object (position_check.h) is not an error.  Cost: three rays where
  /// both
  /// places are in sight of those of the call before, as along a walk or among listeners of a room; else air_connection.h.
  [[nodiscard]] std::vector<std::string> check(const NamedPlace& source, const NamedPlace& listener) const;
  /// A line if the place lies inside a wall or a thing.  About 0.1 s for 150,000 triangles on the first call.
  [[nodiscard]] std::optional<std::string> inside_solid(const NamedPlace& place) const;

 private:
  [[nodiscard]] const PositionCheck& positions() const;
  [[nodiscard]] std::string text_of(const NamedPlace& place) const;
  [[nodiscard]] AirBetween air(glm::vec3 source, glm::vec3 listener) const;
  [[nodiscard]] bool is_closed_room() const;
  [[noreturn]] void refuse(const NamedPlace& outside, const NamedPlace& enclosed) const;

  const AcousticScene& acoustics_;
  mutable std::mutex mutex_;  // guards what is below
  mutable std::unique_ptr<const PositionCheck> positions_;
  mutable std::optional<bool> is_closed_room_;
  /// The pair of the call before.
  struct CheckedPair {
    glm::vec3 source{0}, listener{0};
    AirBetween air = AirBetween::joined;
  };
  mutable std::optional<CheckedPair> before_;
};

}  // namespace earshot
