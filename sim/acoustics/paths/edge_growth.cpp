// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_growth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/paths/path_level.h"

namespace earshot {
namespace {

constexpr double kMaxLossDb = 30;  // of an estimate, over all edges but the last
constexpr double kRoundingDb = 1e-3;

glm::dvec3 nearest_point(const DiffractionEdge& edge, glm::dvec3 point) {
  return edge.at(std::clamp(glm::dot(point - edge.start, edge.along), 0.0, edge.length_m));
}

using ThreeLanes = std::array<Lanes, 3>;

ThreeLanes three(glm::dvec3 v) {
  return {all_lanes(static_cast<float>(v.x)), all_lanes(static_cast<float>(v.y)), all_lanes(static_cast<float>(v.z))};
}
Lanes dot(const ThreeLanes& a, const ThreeLanes& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
ThreeLanes minus(const ThreeLanes& a, const ThreeLanes& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
ThreeLanes plus(const ThreeLanes& a, const Lanes& t, const ThreeLanes& b) { return {a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]}; }
/// Between 0 and `most`.
Lanes limited(const Lanes& x, const Lanes& most) { return x < 0.f ? Lanes{} : x > most ? most : x; }

/// Kurze and Anderson as a factor: 10^(-5 / 20) tanh(x) / x.
Lanes kurze_anderson_factor(const Lanes& fresnel_number) {
  const Lanes x = root_of(fresnel_number * (2.f * std::numbers::pi_v<float>)), fall = exp_of_negative(-2.f * x);
  return 0.562341325f * (x < 0.02f ? all_lanes(1.f) : (1.f - fall) / ((1.f + fall) * x));
}

/// Limits of links that all edges have in common.
struct LinkLimits {
  float slack_m = 0;           ///< error of a length of single precision
  float clearance_m = 0;       ///< within which a point counts as on the faces of an edge
  float longest_m = 0;         ///< way of a sequence
  float half_waves_per_m = 0;  ///< at the frequency that ranks
};

/// The last edge of a sequence, for links to eight edges at a time.  Lengths of single precision are wrong by less than slack_m, so that
/// all that follows errs to the side of the better score.
struct LastEdgeLanes {
  /// By Fermat's point of the last edge to one point of each of eight others.
  struct Way {
    Lanes away_there;   ///< distance of these points from the last edge's line
    Lanes in_m, out_m;  ///< to Fermat's point, and on from it
  };
  struct Links {
    LaneIntegers is_impossible;  ///< certainly no sequence
    Lanes factor, way_m;
  };

  LastEdgeLanes(const DiffractionEdge& edge, const EdgeCandidate& parent, const LinkLimits& limits)
      : here(three(glm::dvec3(parent.before))),
        start(three(edge.start)),
        along(three(edge.along)),
        first_normal(three(edge.first_normal)),
        second_normal(three(edge.second_normal)),
        face(three(edge.face)),
        exterior(static_cast<float>(edge.exterior_rad)),
        length_m(static_cast<float>(edge.length_m)),
        reached_m(parent.reached_m),
        slack_m(limits.slack_m),
        outside_m(limits.clearance_m + limits.slack_m),
        most_m(limits.longest_m),
        half_waves_per_m(limits.half_waves_per_m) {
    const glm::dvec3 before(parent.before), from_edge = before - edge.start;
    const double along_before = glm::dot(from_edge, edge.along), away_before = glm::length(from_edge - along_before * edge.along);
    along_here = static_cast<float>(along_before);
    away_here = static_cast<float>(away_before);
    angle_here = static_cast<float>(edge.angle_of(before));
    least_factor = static_cast<float>(std::pow(10.0, -0.05 * (kMaxLossDb + 0.1 - static_cast<double>(parent.loss_db))));
  }

  [[nodiscard]] Way way_to(const ThreeLanes& from_start) const {
    const Lanes along_there = dot(from_start, along);
    const ThreeLanes away = plus(from_start, -along_there, along);
    const Lanes away_there = root_of(dot(away, away)), both = away_there + away_here;
    const Lanes free = (along_here * away_there + along_there * away_here) / (both < 1e-20f ? all_lanes(1e-20f) : both);
    const Lanes at = limited(both > 0.f ? free : all_lanes(0.5f * length_m), all_lanes(length_m));
    const Lanes in_along = at - along_here, out_along = at - along_there;
    return {.away_there = away_there,
            .in_m = root_of(in_along * in_along + away_here * away_here),
            .out_m = root_of(out_along * out_along + away_there * away_there)};
  }

  /// On the lit side of the edge; points near the edge, at its faces or inside its solid count as behind it.
  [[nodiscard]] LaneIntegers is_lit(const ThreeLanes& from_start, const Lanes& height, const Lanes& away_there) const {
    const Lanes argument_there = argument({dot(from_start, face), height});
    const Lanes angle = argument_there < 0.f ? argument_there + 2.f * std::numbers::pi_v<float> : argument_there;
    const Lanes turn = angle < angle_here ? angle_here - angle : angle - angle_here;
    return (turn < std::numbers::pi_v<float> - 2e-3f) & (angle > 2e-3f) & (angle < exterior - 2e-3f) & (away_there > 1e3f * slack_m);
  }

  /// To eight edges, each at its point nearest to `here`.
  [[nodiscard]] Links links_to(const ThreeLanes& edge_start, const ThreeLanes& edge_along, const Lanes& edge_length_m) const {
    const ThreeLanes after = plus(edge_start, limited(dot(minus(here, edge_start), edge_along), edge_length_m), edge_along);
    const ThreeLanes from_start = minus(after, start);
    const Lanes height = dot(from_start, first_normal);
    const LaneIntegers solid = (height < -outside_m) & (dot(from_start, second_normal) < -outside_m);
    const Way way = way_to(from_start);
    const ThreeLanes straight = minus(after, here);
    const Lanes detour_m = way.in_m + way.out_m - root_of(dot(straight, straight)) - slack_m;
    const Lanes fresnel_number = half_waves_per_m * (detour_m < 0.f ? Lanes{} : detour_m);
    const Lanes factor = kurze_anderson_factor(fresnel_number);
    const LaneIntegers lit = is_lit(from_start, height, way.away_there) & (fresnel_number > 2.f);
    const Lanes way_m = reached_m + way.in_m + way.out_m - slack_m;
    const LaneIntegers too_weak = (factor < least_factor) | (way_m > most_m);
    return {.is_impossible = solid | lit | too_weak, .factor = factor, .way_m = way_m};
  }

  ThreeLanes here, start, along, first_normal, second_normal, face;
  float exterior, length_m, reached_m;
  float along_here = 0, away_here = 0, angle_here = 0;  ///< of the end of the sequence before the edge
  float least_factor = 0;                               ///< of a loss that is not too much
  float slack_m, outside_m, most_m, half_waves_per_m;
};

}  // namespace

EdgeGrowth::EdgeGrowth(const AcousticScene& scene, glm::vec3 source) : scene_(scene), edges_(*scene.diffraction_edges()), source_(source) {
  lanes_.resize((edges_.size() + kLanes - 1) / kLanes);
  for (std::uint32_t i = 0; i < edges_.size(); ++i) {
    const DiffractionEdge& edge = edges_[i];
    EdgeLanes& lanes = lanes_[i / kLanes];
    const std::size_t lane = i % kLanes;
    for (int axis = 0; axis < 3; ++axis) {
      lanes.start[static_cast<std::size_t>(axis)][lane] = static_cast<float>(edge.start[axis]);
      lanes.along[static_cast<std::size_t>(axis)][lane] = static_cast<float>(edge.along[axis]);
      largest_m_ = std::max({largest_m_, static_cast<float>(std::abs(edge.start[axis])), std::abs(source[axis])});
    }
    lanes.length_m[lane] = static_cast<float>(edge.length_m);
    lanes.root_of_length[lane] = static_cast<float>(std::sqrt(edge.length_m));
  }
  EdgeCandidate root;
  root.before = source_;
  add_family(root);
}

void EdgeGrowth::add_family(const EdgeCandidate& parent) {
  Family family;
  family.parent = parent;
  family.index = num_families_++;
  const auto order = static_cast<std::size_t>(parent.sequence.order);
  family.most_db = kRoundingDb - static_cast<double>(parent.loss_db);
  if (order == 0) {
    add_links_of_source(family);
  } else if (edges_[parent.sequence.edge[order - 1]].in_air(glm::dvec3(parent.before), edges_.clearance_m())) {
    add_links_of_edge(family);
  }
  if (family.links.empty()) return;
  std::make_heap(family.links.begin(), family.links.end());
  family.best_db = level_db(static_cast<double>(family.links.front().bound)) + family.most_db;
  (order == 0                                                      ? roots_
   : parent.sequence.order + 1 < scene_.config().diffraction_order ? growing_
                                                                   : full_)
      .families.push_back(std::move(family));
}

void EdgeGrowth::add_links_of_source(Family& family) const {
  const glm::dvec3 before(source_);
  for (std::uint32_t edge = 0; edge < edges_.size(); ++edge) {
    const double length_m = glm::length(nearest_point(edges_[edge], before) - before);
    if (length_m > 1.0001 * static_cast<double>(scene_.max_path_m())) continue;
    const double root_of_length = std::sqrt(edges_[edge].length_m);
    family.links.push_back({static_cast<float>(root_of_length / std::max(length_m, double{kMinDistanceM})), edge});
  }
}

void EdgeGrowth::add_links_of_edge(Family& family) const {
  const EdgeCandidate& parent = family.parent;
  const auto path = std::span(parent.sequence.edge).first(static_cast<std::size_t>(parent.sequence.order));
  const float reach_m = largest_m_ + std::max({std::abs(parent.before.x), std::abs(parent.before.y), std::abs(parent.before.z)}) +
                        static_cast<float>(scene_.max_path_m());
  const LinkLimits limits{.slack_m = 2e-6f * reach_m,
                          .clearance_m = static_cast<float>(edges_.clearance_m()),
                          .longest_m = 1.0001f * static_cast<float>(scene_.max_path_m()),
                          .half_waves_per_m = static_cast<float>(2.0 * kRankingHz / static_cast<double>(scene_.speed_of_sound_m_per_s()))};
  const LastEdgeLanes last(edges_[path.back()], parent, limits);

  for (std::size_t group = 0; group < lanes_.size(); ++group) {
    const EdgeLanes& edge = lanes_[group];
    const LastEdgeLanes::Links links = last.links_to(edge.start, edge.along, edge.length_m);
    // Sequences that are not in sight are dropped sooner or later; those of which that is known, here.
    static_assert(kLanes == EdgeSight::kGroup);
    const std::uint32_t hidden = edges_.known_hidden(path.back(), static_cast<std::uint32_t>(group));
    const Lanes least_m = links.way_m < kMinDistanceM ? all_lanes(kMinDistanceM) : links.way_m;
    const Lanes bound = 1.01f * links.factor * edge.root_of_length / least_m;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const auto index = static_cast<std::uint32_t>(group * kLanes + lane);
      if (links.is_impossible[lane] != 0 || (hidden >> lane & 1u) != 0 || index >= edges_.size() ||
          std::ranges::find(path, index) != path.end())
        continue;
      family.links.push_back({bound[lane], index});
    }
  }
}

void EdgeGrowth::pop_link(Family& family) {
  std::pop_heap(family.links.begin(), family.links.end());
  family.links.pop_back();
  family.best_db = family.links.empty() ? -1e9 : level_db(static_cast<double>(family.links.front().bound)) + family.most_db;
}

bool EdgeGrowth::score(const Family& family, std::uint32_t edge, RankedCandidate& ranked) const {
  const EdgeCandidate& parent = family.parent;
  const auto order = static_cast<std::size_t>(parent.sequence.order);
  const glm::dvec3 before(parent.before), after = nearest_point(edges_[edge], before);
  ranked.family = family.index;
  EdgeCandidate& child = ranked.candidate;
  child = parent;
  child.sequence.edge[order] = edge;
  ++child.sequence.order;
  if (order > 0) {
    const DiffractionEdge& last_edge = edges_[parent.sequence.edge[order - 1]];
    if (!last_edge.in_air(after, edges_.clearance_m())) return false;
    const glm::dvec3 at = last_edge.at(std::clamp(fermat_point(last_edge, before, after), 0.0, last_edge.length_m));
    const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
    const double fresnel_number = 2.0 * detour_m * kRankingHz / static_cast<double>(scene_.speed_of_sound_m_per_s());
    const double loss_db = static_cast<double>(parent.loss_db) + kurze_anderson_db(fresnel_number);
    if (loss_db > kMaxLossDb) return false;
    const bool lit = std::abs(last_edge.angle_of(before) - last_edge.angle_of(after)) < std::numbers::pi;
    if (lit && fresnel_number > 2.0) return false;
    child.before = glm::vec3(at);
    child.reached_m = parent.reached_m + static_cast<float>(glm::length(at - before));
    child.loss_db = static_cast<float>(loss_db);
  }
  const double length_m = static_cast<double>(child.reached_m) + glm::length(after - glm::dvec3(child.before));
  if (length_m > static_cast<double>(scene_.max_path_m())) return false;
  // Long edges first: the frame of a door is passed by many more listeners than the rim of a table.
  ranked.score_db =
      0.5 * level_db(edges_[edge].length_m) - level_db(std::max(length_m, double{kMinDistanceM})) - static_cast<double>(child.loss_db);
  return true;
}

bool EdgeGrowth::in_sight(const EdgeCandidate& candidate) const {
  const auto order = static_cast<std::size_t>(candidate.sequence.order);
  const std::uint32_t last = candidate.sequence.edge[order - 1];
  return order == 1 ? edges_.visible_from(last, source_) : edges_.mutually_visible(candidate.sequence.edge[order - 2], last);
}

const RankedCandidate* EdgeGrowth::top(Queue& queue) {
  for (;;) {
    const auto best = std::max_element(queue.families.begin(), queue.families.end(),
                                       [](const Family& a, const Family& b) { return a.best_db < b.best_db; });
    const bool waiting = best != queue.families.end() && !best->links.empty();
    if (!waiting || (!queue.scored.empty() && queue.scored.top().score_db > best->best_db)) break;
    RankedCandidate ranked;
    if (score(*best, best->links.front().edge, ranked)) queue.scored.push(ranked);
    pop_link(*best);
  }
  return queue.scored.empty() ? nullptr : &queue.scored.top();
}

void EdgeGrowth::expand(int expansions) {
  if (scene_.config().diffraction_order < 2) return;
  while (expansions > 0) {
    const RankedCandidate *root = top(roots_), *longer = top(growing_);
    if (root == nullptr && longer == nullptr) return;
    Queue& queue = longer == nullptr || (root != nullptr && *longer < *root) ? roots_ : growing_;
    const RankedCandidate ranked = queue.scored.top();
    queue.scored.pop();
    if (!in_sight(ranked.candidate)) continue;
    found_of(ranked.candidate).push_back(ranked);
    add_family(ranked.candidate);
    --expansions;
  }
}

void EdgeGrowth::complete(std::initializer_list<Queue*> queues, std::size_t wanted, std::vector<RankedCandidate>& found) {
  const auto stronger = [](const RankedCandidate& a, const RankedCandidate& b) { return b < a; };
  std::sort(found.begin(), found.end(), stronger);
  for (;;) {
    Queue* best = nullptr;
    for (Queue* queue : queues)
      if (top(*queue) != nullptr && (best == nullptr || best->scored.top() < queue->scored.top())) best = queue;
    if (best == nullptr) break;
    const RankedCandidate next = best->scored.top();
    if (found.size() >= wanted && (wanted == 0 || next < found[wanted - 1])) break;
    best->scored.pop();
    if (in_sight(next.candidate)) found.insert(std::upper_bound(found.begin(), found.end(), next, stronger), next);
  }
}

std::vector<RankedCandidate> EdgeGrowth::strongest(std::size_t limit) {
  const auto cut = [](std::vector<RankedCandidate>& found, std::size_t most) {
    if (found.size() > most) found.resize(most);
  };
  // As many single ones as decide how much room the others have, then those, then what room is left.
  complete({&roots_}, limit - limit / 2, single_);
  const std::size_t room = std::max(limit / 2, limit - std::min(limit, single_.size()));
  complete({&growing_, &full_}, room, longer_);
  cut(longer_, room);
  complete({&roots_}, limit - longer_.size(), single_);
  cut(single_, limit - longer_.size());
  std::vector<RankedCandidate> all = single_;
  all.insert(all.end(), longer_.begin(), longer_.end());
  std::sort(all.begin(), all.end(), [](const RankedCandidate& a, const RankedCandidate& b) { return b < a; });
  return all;
}

}  // namespace earshot
