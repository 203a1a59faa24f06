// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Paths shorter than this count as this long (docs/evidence/stability.md, H-13): level and delay stay finite and continuous down to source
/// == listener.
inline constexpr float kMinDistanceM = 0.01f;

/// How a deterministic path gets from source to listener.
enum class ArrivalKind : std::uint8_t {
  direct,        ///< in line of sight
  reflection,    ///< mirrored in one or more planes
  diffraction,   ///< round one or more edges
  transmission,  ///< straight through one or more walls
};

/// Identity of a path by the planes or edges that it meets, in the order from the source: the same at every pose of the same scene, so that
/// a path can be followed while source or listener move.  The straight line is one path whether a wall is in its way or not.
std::uint64_t path_identity(ArrivalKind kind, std::span<const std::uint32_t> met);

/// One deterministic arrival, before any head or microphone.
struct Arrival {
  ArrivalKind kind = ArrivalKind::direct;
  std::uint64_t identity = 0;  ///< path_identity; 0: not known
  int order = 0;               ///< number of reflections, edges or walls; 0 for the direct sound alone
  float distance_m = 0;        ///< delay times the speed of sound in air: the path length, except inside walls with a speed of their own
  glm::vec3 direction{0};      ///< unit, from the listener toward where the sound comes from, world axes; front (-z) if source == listener
  glm::vec3 departure{0};      ///< unit, from the source toward where the sound goes, world axes; -direction for a straight path
  /// Pressure amplitude per band, Green units, >= 0: 1 / (4 pi r) times the roots of all energy fractions, times the source's gain.
  std::array<float, kMaxBands> amplitude{};
  /// Phase at the band centre beyond that of the delay, convention exp(+j w t).  Diffracted paths, the paths they interfere with, and
  /// reflections of panels and of locally reacting walls have one.
  std::array<float, kMaxBands> phase_rad{};
};

}  // namespace earshot
