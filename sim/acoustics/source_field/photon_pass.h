// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/path_tracer.h"

namespace earshot {

/// Contributions of the photons of a chunk, in the order in which they arose.
struct PhotonTracks {
  /// A straight segment through the air, after the direct sound and beside image paths.
  struct Segment {
    glm::vec3 direction;
    float path_m;  ///< from the source to where it begins
    std::uint32_t first_crossing, end_crossing;
  };
  std::vector<Segment> segments;
  std::vector<float> energy;  ///< [segments][padded bands], of a source that emits 1 through one photon
  std::vector<FieldGrid::Crossing> crossings;
  void clear() { segments.clear(), energy.clear(), crossings.clear(); }
};

/// Unit of work, of the order of summation, and of error estimates: photons of a chunk are balanced against each other
/// (population_control.h).
inline constexpr std::uint32_t kPhotonsPerChunk = 64;

/// Traces chunk number `chunk` of the photons of a source, through mirrors, diffuse reflections and, where the late field is traced through
/// them, walls.  Overwrites `tracks`.  Chunks are independent, and each is a function of (scene, source, grid, chunk).
void trace_photons(const AcousticScene& scene, const EarlyCandidates& candidates, const FieldGrid& grid, std::uint32_t chunk,
                   PhotonTracks& tracks, TraceStats& stats);

}  // namespace earshot
