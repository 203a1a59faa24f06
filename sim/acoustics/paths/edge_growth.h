// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <initializer_list>
#include <queue>
#include <tuple>
#include <vector>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/band_lanes.h"
#include "sim/acoustics/paths/edge_path.h"

namespace earshot {

/// A sequence of edges by which sound of one source may go, without the listener.
struct EdgeCandidate {
  EdgeSequence sequence;
  glm::vec3 before{0};  ///< where the last segment but one starts, about: source or a point of the last edge but one
  float reached_m = 0;  ///< length of the way to there, about
  float loss_db = 0;    ///< estimate of all edges but the last
};

/// An EdgeCandidate with its rank: the stronger the more likely it is to carry sound, the earlier found of two alike.
struct RankedCandidate {
  double score_db = 0;
  std::uint32_t family = 0;  ///< the sequence that it extends
  EdgeCandidate candidate;
  [[nodiscard]] std::uint32_t last_edge() const { return candidate.sequence.edge[static_cast<std::size_t>(candidate.sequence.order - 1)]; }
  /// Weaker than?
  bool operator<(const RankedCandidate& other) const {
    return std::make_tuple(score_db, other.family, other.last_edge()) < std::make_tuple(other.score_db, family, last_edge());
  }
};

/// Grows edge sequences from a source, best first.  Links are queued by a bound of their score, eight edges at a time and some tenths
/// of a decibel above it at most; the score itself, and the rays, are for those that are next.  The result is that of testing all.
class EdgeGrowth {
 public:
  EdgeGrowth(const AcousticScene& scene, glm::vec3 source);
  /// Grows longer sequences from the best `expansions` of those found.
  void expand(int expansions);
  /// The strongest sequences of one edge, and of several, at most `limit` together: single ones come without a loss and would crowd out
  /// the others where there are many, so they get half of `limit` if it is short.  Strongest first.
  [[nodiscard]] std::vector<RankedCandidate> strongest(std::size_t limit);

 private:
  /// A sequence and one edge more, not yet tested.
  struct Link {
    float bound;  ///< at least the root of the edge's length over the length of the way to it, times what the edge before leaves of it
    std::uint32_t edge;
    bool operator<(const Link& other) const { return std::tie(bound, other.edge) < std::tie(other.bound, edge); }
  };
  struct Family {
    EdgeCandidate parent;  ///< of order 0: the source
    double most_db = 0;    ///< no link scores more than 20 log10(bound) plus this
    std::uint32_t index = 0;
    std::vector<Link> links;  ///< a heap
    double best_db = 0;       ///< bound of the first
  };
  /// Families whose sequences compete, and what has been scored of them.
  struct Queue {
    std::vector<Family> families;
    std::priority_queue<RankedCandidate> scored;
  };

  void add_family(const EdgeCandidate& parent);
  void add_links_of_source(Family& family) const;
  void add_links_of_edge(Family& family) const;
  void pop_link(Family& family);
  /// False if the sequence is too long or too weak.
  bool score(const Family& family, std::uint32_t edge, RankedCandidate& ranked) const;
  [[nodiscard]] bool in_sight(const EdgeCandidate& candidate) const;
  /// The best sequence of a queue, whatever is in sight; null if there is none.
  const RankedCandidate* top(Queue& queue);
  /// Sorts `found` and goes on until it begins with the `wanted` best of itself and the queues, or nothing is left.
  void complete(std::initializer_list<Queue*> queues, std::size_t wanted, std::vector<RankedCandidate>& found);
  [[nodiscard]] std::vector<RankedCandidate>& found_of(const EdgeCandidate& candidate) {
    return candidate.sequence.order == 1 ? single_ : longer_;
  }

  const AcousticScene& scene_;
  const DiffractionEdges& edges_;
  glm::vec3 source_;
  /// Eight edges; lanes past the last edge have length 0 and bound 0.
  struct EdgeLanes {
    std::array<Lanes, 3> start{}, along{};
    Lanes length_m{}, root_of_length{};
  };
  std::vector<EdgeLanes> lanes_;
  float largest_m_ = 0;  ///< of the coordinates
  std::uint32_t num_families_ = 0;
  Queue roots_, growing_, full_;                  ///< one edge; more, and room for another; as many as config allows
  std::vector<RankedCandidate> single_, longer_;  ///< in sight
};

}  // namespace earshot
