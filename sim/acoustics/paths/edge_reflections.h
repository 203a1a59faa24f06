// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/edge_bands.h"
#include "sim/acoustics/paths/edge_path.h"

namespace earshot {

/// Paths over edges that are reflected once before their first edge, once after their last, or both: those of the edges by which sound gets
/// to one listener already.
///
/// Each is the path over the same edges from the source or its image to the listener or its image (the sum of four screens in free field is
/// a screen on a hard floor), of the field of EdgePathField, times the specular pressure factors of the planes.  Planes are among the
/// scene's kPlanes largest: floor, ceiling, walls.  A path counts in full where the ray from image to image is held back by the edge; where
/// it is an image path that is in sight, the wave of a single edge joins that path with its phase, near its boundary as in
/// DiffractionCandidates.  Together the waves of one pair of planes have at most the energy that the free image would have.  Estimators of
/// the late field diffract nothing: no energy is there twice.  Not here: two reflections on one side, reflections between edges, the size
/// of the planes' panels.
class EdgeReflections {
 public:
  static constexpr std::size_t kPlanes = 16, kSequences = 4, kMost = 24;

  /// bands: edge_bands(scene).  `images` are direct sound and reflections at this pose.  sight_weight: empty where the listener is hidden;
  /// in sight, per band how much all single edges count whatever their detour (1 on a shadow boundary).
  EdgeReflections(const AcousticScene& scene, std::span<const EdgeBands> bands, glm::vec3 source, glm::vec3 listener,
                  std::span<Arrival> images, std::span<const double> sight_weight);

  /// Finds the paths that go with these edges (from the source), of which single ones count in sight: the first kSequences are looked at.
  /// Adds waves to `images` and returns the others, at most kMost, the strongest.  Source and listener swapped give the same bits.  About 5
  /// us for each pair of planes that sees both ends; no allocation.
  std::span<const Arrival> find(std::span<const EdgeSequence> sequences);

 private:
  struct EndSegment;
  struct EndSegments;
  /// Planes before the first edge and after the last; -1: none.
  struct EndPlanes {
    int first, second;
  };
  [[nodiscard]] EndPlanes in_order_from_source(EndPlanes planes) const {
    return swapped_ ? EndPlanes{planes.second, planes.first} : planes;
  }
  /// An end of the path, mirrored in a plane if there is one.
  [[nodiscard]] glm::dvec3 image_of(glm::vec3 end, int plane) const;
  /// image_path: index of the image path that the wave belongs to; -1: it is a path of its own.
  bool find_path(const EdgeSequence& sequence, EndPlanes planes, Arrival& arrival, int& image_path) const;
  /// Index of the image path by these planes alone; -1: no such path at this pose.
  [[nodiscard]] int find_image_path(EndPlanes planes) const;
  /// How much the wave of a path counts in each band, by how near it is to its boundary; `wedge`: of its first edge.  False if nowhere.
  bool weigh_bands(const DiffractionEdge& first_edge, const FiniteWedge& wedge, bool joins_image, std::span<double> weight) const;
  /// False if anything stands in the way.
  bool follow_segments(const EdgePath& path, EndPlanes planes, EndSegments& ends) const;
  /// Identity, distance and directions.
  void describe(const EdgePath& path, EndPlanes planes, const EndSegments& ends, Arrival& arrival) const;
  /// Amplitude and phase: `gain` times those of the path, or of the wave of its edge alone.  False if silent.
  bool set_field(const EdgePath& path, const EdgePathField& field, bool joins_image, std::span<const double> gain, Arrival& arrival) const;
  bool follow(glm::dvec3 from, int plane, glm::vec3 to, EndSegment& segment) const;
  /// Is `arrival` worth more than the weakest of those kept?  Then it is kept.
  void keep(const Arrival& arrival);

  const AcousticScene& scene_;
  std::span<const EdgeBands> bands_;
  bool swapped_;         ///< paths are worked out from the listener, so that swapped ends give the same bits
  glm::vec3 from_, to_;  ///< ends of the path as it is worked out
  std::span<Arrival> images_;
  std::span<const double> sight_weight_;
  std::array<Arrival, kMost> arrival_;
  std::size_t count_ = 0;
};

/// Adds `wave` to the path whose identity is kept, with the phases of both at the band centres.
/// groups: edge_bands of the scene.
void add_wave(std::span<const EdgeBands> groups, const Arrival& wave, Arrival& path);

/// Scales waves between two ends so that together they have in no band more energy than the free field: approximations of many edges must
/// not add up to more than there is.
void cap_at_free_field(int num_bands, glm::dvec3 from, glm::dvec3 to, std::span<Arrival> waves);

}  // namespace earshot
