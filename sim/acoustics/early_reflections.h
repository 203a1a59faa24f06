#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"

namespace earshot {

/// Paths shorter than this count as this long (ORACLES H-13): level and delay stay finite and continuous down to source == listener.
inline constexpr float kLeastDistanceM = 0.01f;

/// One deterministic arrival: direct sound (order 0) or an image path.
struct Arrival {
  float distance_m = 0;       ///< path length; delay = distance / c
  glm::vec3 direction{0};     ///< unit, from the listener toward where the sound comes from, world axes; front (-z) if source == listener
  int order = 0;              ///< number of specular reflections
  /// Pressure amplitude per band, Green units: prod sqrt((1 - a)(1 - s)) exp(-m r / 2) / (4 pi r).
  std::array<float, kMaxBands> amplitude{};
};

/// Image-source candidates of one source position: the plane sequences that specular rays from it meet, plus, in scenes of few planes
/// (at most 2048 sequences of that order), all sequences.  Immutable; shared by every listener pose and episode of that source.
/// Image sources: Allen and Berkley 1979 for a box, Borish 1984 for any polyhedron.
class EarlyCandidates {
 public:
  /// Cost: config.early_candidate_rays times early_order rays.
  EarlyCandidates(const AcousticScene& scene, glm::vec3 source);
  /// Appends the valid arrivals at `listener`: direct sound if in line of sight, then image paths whose every leg is confirmed by a ray.
  /// A path through the edge of two planes, which two sequences find, counts once.  Arrivals that carry no energy (fully absorbing or
  /// fully scattering surfaces) or come after config.rir_length_s are left out.  The appended part is sorted by (distance, plane
  /// sequence): same input, same bits.  Source and listener swapped give the bits of the same distances and amplitudes.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const;
  /// Is this plane sequence, in the order seen from the source, among the candidates?  Then image paths carry its specular energy.
  [[nodiscard]] bool contains(std::span<const std::uint32_t> planes) const;
  [[nodiscard]] glm::vec3 source() const { return source_; }
  [[nodiscard]] std::size_t size() const { return sequences_.size(); }

 private:
  static constexpr int kMaxOrder = 4;
  struct Sequence {
    std::array<std::uint32_t, kMaxOrder> plane{};
    int order = 0;
    auto operator<=>(const Sequence&) const = default;
  };
  bool find_path(const AcousticScene& scene, std::size_t index, glm::vec3 listener, Arrival& arrival) const;

  glm::vec3 source_;
  std::vector<Sequence> sequences_;  ///< sorted, unique
  std::vector<glm::dvec3> images_;   ///< the source mirrored in all planes of the sequence
};

}  // namespace earshot
