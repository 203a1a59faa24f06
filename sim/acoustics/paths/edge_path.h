// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/vec3.hpp>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/paths/edge_bands.h"
#include "sim/acoustics/paths/finite_edge.h"

namespace earshot {

inline constexpr int kMaxDiffractionOrder = 10;

/// The edges that a path goes over, in order.
struct EdgeSequence {
  std::array<std::uint32_t, kMaxDiffractionOrder> edge{};
  int order = 0;
};

/// The point of the line through the edge by which the way from a to b is shortest (equal angles with the edge on both sides), as a
/// distance from the edge's start; not limited to the edge.  On the line itself: the middle of the edge.
double fermat_point(const DiffractionEdge& edge, glm::dvec3 a, glm::dvec3 b);

/// The shortest way from `from` over the edges to `to` (Fermat): exact for one edge, by Newton's method on the convex length for several.
/// Points of an edge's line past its end are moved to the end, and the others with them.
struct EdgePath {
  EdgeSequence sequence;
  glm::dvec3 from{0}, to{0};
  std::array<double, kMaxDiffractionOrder> along_m{};  ///< on each edge, between its ends
  std::array<glm::dvec3, kMaxDiffractionOrder> point{};
  double length_m = 0;  ///< of the way by these points

  /// Path length for levels and delays: at least kMinDistanceM.
  [[nodiscard]] double distance_m() const { return std::max(length_m, double{kMinDistanceM}); }
};
/// False if the points of two edges coincide, as at a corner where they meet.
bool shortest_path(const DiffractionEdges& edges, const EdgeSequence& sequence, glm::dvec3 from, glm::dvec3 to, EdgePath& path);

/// Field of a path over the free field at its length: the product of the wedges' ratios (utd.h).
///
/// Several edges: the wedge with the least deviation of the path takes L from the segments next to it, is then left out, and so on; the
/// last takes L from the whole path, as in Deygout's construction.  So the field joins the path that skips an edge where that edge is at
/// its boundary, has Keller's spreading far from all boundaries, stays finite for edges close together, and is reciprocal.  Alone it is up
/// to 2.6 dB too loud for thick walls: far from the boundaries L of every wedge is that of its own segments (with the factor sqrt(product
/// of these L / product of the others)).  The level goes from the one to the other by the fraction
///   q = x / (x + 0.3) * k w / (1 + k w),  x = least sqrt(2 k L) |sin(d / 2)| of all wedges by their own segments, w the shortest inner
///   segment,
/// in dB.  The first factor is fitted to second-order Biot-Tolstoy-Medwin integrals over walls 0.1 to 3 m thick (125 Hz to 2 kHz), which it
/// meets within 0.3 dB; the second takes it back where the edges are closer than sound resolves and a thin screen is the better
/// model.  Against those integrals the whole is 0.6 dB too loud at most for k w > 3.  It is
/// wrong where several edges are at their boundaries at once: two black edges in one line with both ends leave 1/4 instead of 1/3 of the
/// pressure (2.5 dB).
///
/// A segment along the common face of two edges: incident and reflected ray coincide, and the field is divided by 1 + R of that face (K-P
/// 1974 for grazing incidence: half for a rigid face).  Two rims of one sheet have no such segment: not a valid path.
///
/// Each edge ends where it ends (finite_edge.h); in a path over several, source and listener are for each edge where the path, unfolded,
/// has them.  A solid that lets a fraction tau of the energy through takes 1 - sqrt(tau) of the jump behind its first edge: without one
/// the edge has nothing to make up for (Babinet's principle).  Edges that share a face belong to one solid.
class EdgePathField {
 public:
  /// in_sight: is the straight line from end to end free?
  EdgePathField(const DiffractionEdges& edges, const EdgePath& path, bool in_sight = false);
  /// False if a segment runs inside a wedge or along a sheet from rim to rim.
  [[nodiscard]] bool valid() const { return valid_; }
  /// The first edge of the path.
  [[nodiscard]] const FiniteWedge& first_edge() const { return wedges_[0].diffraction; }
  /// Over the free field at path.length_m, in the bands of a group.
  [[nodiscard]] ComplexLanes ratio(const EdgeBands& bands) const;

 private:
  struct Wedge {
    FiniteWedge diffraction;
    double length_m = 0, own_length_m = 0;  ///< L by rank and by its own segments
    bool ranks_by_own_segments = false;     ///< both are the same: that of the least deviation
    std::uint32_t first_material = 0, second_material = 0;
    bool joins_next = false;  ///< the segment to the next edge lies in a face of both
    std::uint32_t shared_material = 0, next_shared_material = 0;
  };
  int order_ = 0;
  bool valid_ = true;
  double spreading_ = 1;          ///< product of L by own segments over product of L by rank
  double least_deviation_m_ = 0;  ///< least L sin^2(d / 2), by own segments
  double least_segment_m_ = 0;    ///< between two edges
  std::array<Wedge, kMaxDiffractionOrder> wedges_;
};

}  // namespace earshot
