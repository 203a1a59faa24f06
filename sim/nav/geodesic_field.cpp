// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/geodesic_field.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <span>
#include <sstream>

#include "sim/base/errors.h"
#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kOffWallM = 1e-4;   // walks start this far from walls: above the rounding of float positions
constexpr double kAtCornerM = 0.01;  // an agent this near a corner has reached it
constexpr std::uint32_t kGoal = 0xFFFFFFFFu;

glm::dvec3 off_walls(const Surface& surface, const Located& at) { return surface.off_walls(at.polygon, glm::dvec3(at.point), kOffWallM); }

double horizontal_distance(glm::dvec3 a, glm::dvec3 b) {
  const double dx = a.x - b.x, dz = a.z - b.z;
  return std::sqrt(dx * dx + dz * dz);
}

// Whether a shortest path can come to `corner` straight from `point`.
bool is_tangent_from(const Corner& corner, glm::dvec3 point, double distance_m) {
  if (distance_m <= 0) return true;
  const glm::dvec3 direction{(corner.position.x - point.x) / distance_m, 0, (corner.position.z - point.z) / distance_m};
  return is_tangent(corner, direction, tangent_slack(distance_m));
}

}  // namespace

struct GeodesicField::Impl {
  // First target of a query, a corner or the goal, and length of the whole path.
  struct Answer {
    double length_m = kInfinity;
    std::uint32_t via = kGoal;
  };

  const Navmesh::Impl& nav;
  const CornerGraph& graph;
  Located goal;
  glm::dvec3 goal_start;
  int island;
  std::vector<double> to_goal_m;    ///< per corner; infinite where the goal cannot be reached
  std::vector<std::uint32_t> next;  ///< per corner: next corner toward the goal, or kGoal
  // Corners from which the goal can be reached, by what their lower bounds are made of.
  std::vector<std::uint32_t> useful;
  std::vector<double> useful_x, useful_z, useful_to_goal_m;
  /// [polygons] The corner that won where this polygon was asked from last: the next answer from there is hardly ever longer than the way
  /// over it, and corners further round are skipped.  The answers do not depend on it.
  mutable std::vector<std::atomic<std::uint32_t>> last_winner;

  Impl(const Navmesh::Impl& n, const Located& g) : nav(n), graph(n.corners()), goal(g), goal_start(off_walls(n.surface, g)) {
    island = nav.surface.polygons()[goal.polygon].island;
    run_dijkstra();
    last_winner = std::vector<std::atomic<std::uint32_t>>(nav.surface.polygons().size());
    for (auto& winner : last_winner) winner.store(kGoal, std::memory_order_relaxed);
  }

  void run_dijkstra() {
    const auto corners = graph.corners();
    to_goal_m.assign(corners.size(), kInfinity);
    next.assign(corners.size(), kGoal);
    using Entry = std::pair<double, std::uint32_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    for (std::uint32_t c = 0; c < corners.size(); ++c) {
      if (corners[c].island != island) continue;
      const double distance_m = horizontal_distance(corners[c].position, goal_start);
      if (!is_tangent_from(corners[c], goal_start, distance_m)) continue;
      const Surface::Walk walk = nav.surface.walk(goal.polygon, goal_start, corners[c].position);
      if (!walk.arrived) continue;
      to_goal_m[c] = walk.length_m;
      open.push({walk.length_m, c});
    }
    while (!open.empty()) {
      const auto [length_m, corner] = open.top();
      open.pop();
      if (length_m > to_goal_m[corner]) continue;
      for (const CornerGraph::Edge& edge : graph.edges_of(corner)) {
        const double through_m = length_m + edge.length_m;
        if (through_m >= to_goal_m[edge.to]) continue;
        to_goal_m[edge.to] = through_m;
        next[edge.to] = corner;
        open.push({through_m, edge.to});
      }
    }
    for (std::uint32_t c = 0; c < corners.size(); ++c) {
      if (!(to_goal_m[c] < kInfinity)) continue;
      useful.push_back(c);
      useful_x.push_back(corners[c].position.x);
      useful_z.push_back(corners[c].position.z);
      useful_to_goal_m.push_back(to_goal_m[c]);
    }
  }

  /// Of the way straight to the corner and on from there; infinite where it is out of sight or no shortest path turns at it.
  [[nodiscard]] double length_over(const Located& at, glm::dvec3 start, std::uint32_t number) const {
    const Corner& corner = graph.corners()[number];
    if (!is_tangent_from(corner, start, horizontal_distance(corner.position, start))) return kInfinity;
    const Surface::Walk walk = nav.surface.walk(at.polygon, start, corner.position);
    return walk.arrived ? walk.length_m + to_goal_m[number] : kInfinity;
  }

  [[nodiscard]] std::optional<Answer> ask(const Located& at) const {
    if (nav.surface.polygons()[at.polygon].island != island) return std::nullopt;
    const glm::dvec3 start = off_walls(nav.surface, at);
    const Surface::Walk direct = nav.surface.walk(at.polygon, start, goal_start);
    if (direct.arrived) return Answer{direct.length_m, kGoal};

    // Lower bound of each corner: straight to it, then on.  A heap yields them in order; the first that is in sight wins, unless
    // slopes made its walk longer than the bound.
    struct Candidate {
      double bound_m;
      std::uint32_t corner;
    };
    std::array<Candidate, 512> storage;
    std::vector<Candidate> overflow;  // empty, without allocation, in any scene of ordinary size
    if (useful.size() > storage.size()) overflow.resize(useful.size());
    const std::span<Candidate> all = overflow.empty() ? std::span<Candidate>(storage) : std::span<Candidate>(overflow);
    // No corner with a bound above the length of a way that is known can win.
    const std::uint32_t hint = last_winner[at.polygon].load(std::memory_order_relaxed);
    const double known_m = hint == kGoal ? kInfinity : length_over(at, start, hint);
    std::size_t count = 0;
    for (std::size_t i = 0; i < useful.size(); ++i) {
      const double left_m = known_m - useful_to_goal_m[i], dx = useful_x[i] - start.x, dz = useful_z[i] - start.z;
      const double square = dx * dx + dz * dz;
      if (left_m < 0 || square > left_m * left_m * (1 + 1e-12)) continue;
      all[count++] = {std::sqrt(square) + useful_to_goal_m[i], useful[i]};
    }
    // At equal bounds the corner nearer to the goal goes first: for an agent on a corner the next one counts.
    const auto later = [&](const Candidate& l, const Candidate& r) {
      return l.bound_m != r.bound_m ? l.bound_m > r.bound_m : to_goal_m[l.corner] > to_goal_m[r.corner];
    };
    const auto first = all.begin(), last = first + static_cast<std::ptrdiff_t>(count);
    std::make_heap(first, last, later);
    Answer best;
    for (auto end = last; end != first; --end) {
      if (first->bound_m >= best.length_m) break;
      const Candidate candidate = *first;
      std::pop_heap(first, end, later);
      const double length_m = candidate.corner == hint ? known_m : length_over(at, start, candidate.corner);
      if (length_m < best.length_m) best = {length_m, candidate.corner};
    }
    if (best.length_m < kInfinity) {
      last_winner[at.polygon].store(best.via, std::memory_order_relaxed);
      return best;
    }
    // If rounding hides every corner, the corridor of Detour gives the length.
    if (const auto length_m = corridor_length_m(nav, at, goal)) return Answer{*length_m, kGoal};
    return std::nullopt;
  }
};

GeodesicField::GeodesicField(const Navmesh& navmesh, glm::vec3 goal, float reach_m) {
  const auto located = navmesh.impl().locate(goal, reach_m);
  if (!located) {
    std::ostringstream shown;
    shown << "goal (" << goal.x << ", " << goal.y << ", " << goal.z << ")";
    throw InputError(shown.str(), "is too far from the walkable surface", "move the goal to the floor, or remove the episode");
  }
  impl_ = std::make_unique<Impl>(navmesh.impl(), *located);
}
GeodesicField::~GeodesicField() = default;
GeodesicField::GeodesicField(GeodesicField&&) noexcept = default;

std::optional<float> GeodesicField::distance_m(glm::vec3 point) const {
  const auto located = impl_->nav.locate(point, kReachM);
  if (!located) return std::nullopt;
  const auto answer = impl_->ask(*located);
  if (!answer) return std::nullopt;
  return static_cast<float>(answer->length_m);
}

std::optional<glm::vec3> GeodesicField::next_corner(glm::vec3 point) const {
  const auto located = impl_->nav.locate(point, kReachM);
  if (!located) return std::nullopt;
  const auto answer = impl_->ask(*located);
  if (!answer) return std::nullopt;
  std::uint32_t via = answer->via;
  const auto corners = impl_->graph.corners();
  if (via != kGoal && horizontal_distance(corners[via].position, glm::dvec3(located->point)) < kAtCornerM) via = impl_->next[via];
  return via == kGoal ? impl_->goal.point : glm::vec3(corners[via].position);
}

glm::vec3 GeodesicField::goal() const { return impl_->goal.point; }

}  // namespace earshot
