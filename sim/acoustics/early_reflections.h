#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"

namespace earshot {

/// One deterministic arrival: direct sound (order 0) or an image path.
struct Arrival {
  float distance_m = 0;       ///< path length; delay = distance / c
  glm::vec3 direction{0};     ///< unit, from the listener toward where the sound comes from, world axes
  int order = 0;              ///< number of specular reflections
  /// Pressure amplitude per band, Green units: prod sqrt((1 - a)(1 - s)) exp(-m r / 2) / (4 pi r).
  std::array<float, kMaxBands> amplitude{};
};

/// Image-source candidates of one source position: the plane sequences that specular rays from it meet, plus, in scenes of
/// few planes, all sequences.  Immutable; shared by every listener pose and episode of that source.
class EarlyCandidates {
 public:
  EarlyCandidates(const AcousticScene& scene, glm::vec3 source);
  /// Appends the valid arrivals at `listener`: direct sound if in line of sight, then image paths whose every leg is
  /// confirmed by a ray.  Sorted by (distance, plane sequence): same input, same bits.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const;
  [[nodiscard]] glm::vec3 source() const { return source_; }
  [[nodiscard]] std::size_t size() const { return sequences_.size(); }

 private:
  struct Sequence {
    std::array<std::uint32_t, 4> plane;
    int order;
  };
  glm::vec3 source_;
  std::vector<Sequence> sequences_;
};

}  // namespace earshot
