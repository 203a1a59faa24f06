// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_path.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

namespace earshot {
namespace {

using Numbers = std::array<double, kMaxDiffractionOrder>;

glm::dvec3 point_before(const EdgePath& path, int i) { return i > 0 ? path.point[static_cast<std::size_t>(i - 1)] : path.from; }
glm::dvec3 point_after(const EdgePath& path, int i) {
  return i + 1 < path.sequence.order ? path.point[static_cast<std::size_t>(i + 1)] : path.to;
}

double length_of(const EdgePath& path) {
  double sum = 0;
  glm::dvec3 last = path.from;
  for (int i = 0; i < path.sequence.order; ++i) {
    sum += glm::length(path.point[static_cast<std::size_t>(i)] - last);
    last = path.point[static_cast<std::size_t>(i)];
  }
  return sum + glm::length(path.to - last);
}

void place(const DiffractionEdges& edges, EdgePath& path) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(path.sequence.order); ++i)
    path.point[i] = edges[path.sequence.edge[i]].at(path.along_m[i]);
}

/// Each point in turn to its best place between its neighbours, kept on the edge or not.  Returns the largest move.
double sweep(const DiffractionEdges& edges, bool keep_on_edge, EdgePath& path) {
  double largest_m = 0;
  for (int i = 0; i < path.sequence.order; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const DiffractionEdge& edge = edges[path.sequence.edge[at]];
    double along_m = fermat_point(edge, point_before(path, i), point_after(path, i));
    if (keep_on_edge) along_m = std::clamp(along_m, 0.0, edge.length_m);
    largest_m = std::max(largest_m, std::abs(along_m - path.along_m[at]));
    path.along_m[at] = along_m;
    path.point[at] = edge.at(along_m);
  }
  return largest_m;
}

/// One Newton step on path.length_m, halved until it does not grow.  The Hessian is tridiagonal and positive.  Returns the largest move.
double newton_step(const DiffractionEdges& edges, EdgePath& path) {
  const auto order = static_cast<std::size_t>(path.sequence.order);
  Numbers gradient{}, diagonal{}, upper{};
  for (std::size_t i = 0; i < order; ++i) {
    const glm::dvec3 axis = edges[path.sequence.edge[i]].along;
    const glm::dvec3 in = path.point[i] - point_before(path, static_cast<int>(i)),
                     out = point_after(path, static_cast<int>(i)) - path.point[i];
    const double in_m = glm::length(in), out_m = glm::length(out);
    if (!(in_m > 0) || !(out_m > 0)) return 0;
    const double cos_in = glm::dot(axis, in) / in_m, cos_out = glm::dot(axis, out) / out_m;
    gradient[i] = cos_in - cos_out;
    diagonal[i] = (1 - cos_in * cos_in) / in_m + (1 - cos_out * cos_out) / out_m;
    if (!(diagonal[i] > 0)) return 0;
    if (i + 1 < order) {
      const glm::dvec3 next = edges[path.sequence.edge[i + 1]].along;
      upper[i] = -(glm::dot(axis, next) - cos_out * glm::dot(next, out) / out_m) / out_m;
    }
  }
  Numbers step = gradient;
  for (std::size_t i = 1; i < order; ++i) {
    const double factor = upper[i - 1] / diagonal[i - 1];
    diagonal[i] -= factor * upper[i - 1];
    step[i] -= factor * step[i - 1];
    if (!(diagonal[i] > 0)) return 0;
  }
  for (std::size_t i = order; i-- > 0;) step[i] = (step[i] - (i + 1 < order ? upper[i] * step[i + 1] : 0.0)) / diagonal[i];

  const Numbers start = path.along_m;
  for (double fraction = 1; fraction > 1e-3; fraction *= 0.5) {
    double largest_m = 0;
    for (std::size_t i = 0; i < order; ++i) {
      path.along_m[i] = start[i] - fraction * step[i];
      largest_m = std::max(largest_m, std::abs(fraction * step[i]));
    }
    place(edges, path);
    const double length_m = length_of(path);
    if (!(length_m <= path.length_m)) continue;
    path.length_m = length_m;
    return largest_m;
  }
  path.along_m = start;
  place(edges, path);
  return 0;
}

/// A path at its edge i, with the segments before and after.
struct PathCorner {
  PathCorner(const DiffractionEdge& at_edge, const EdgePath& path, std::size_t i)
      : edge(at_edge),
        before(point_before(path, static_cast<int>(i))),
        after(point_after(path, static_cast<int>(i))),
        point(path.point[i]),
        in(point - before),
        out(after - point),
        in_m(glm::length(in)),
        out_m(glm::length(out)) {}
  /// False if a segment runs inside the wedge.
  bool find_angles(double clearance_m) {
    if (!edge.in_air(before, clearance_m) || !edge.in_air(after, clearance_m)) return false;
    in_rad = edge.angle_of(before);
    out_rad = edge.angle_of(after);
    return true;
  }

  const DiffractionEdge& edge;
  glm::dvec3 before, after, point, in, out;
  double in_m, out_m;
  double in_rad = 0, out_rad = 0;  ///< about the edge
};

/// The wedge at a corner that a path of `path_m` reaches after `reached_m`, alone or with others.
template <class Wedge>
void set_wedge(const PathCorner& corner, double reached_m, double path_m, bool is_single, Wedge& wedge) {
  const DiffractionEdge& edge = corner.edge;
  const double in_m = corner.in_m, out_m = corner.out_m;
  // Source and listener where the path, unfolded, has them.
  const bool alone = is_single || !(in_m > 0) || !(out_m > 0);
  const glm::dvec3 source = alone ? corner.before : corner.point - corner.in * (reached_m / in_m);
  const glm::dvec3 listener = alone ? corner.after : corner.point + corner.out * ((path_m - reached_m) / out_m);
  wedge.diffraction = FiniteWedge(edge, source, listener, corner.in_rad, corner.out_rad);
  wedge.first_material = edge.first_material;
  wedge.second_material = edge.second_material;
  // sin^2 of the angle with the edge; the same on both sides but where the path is kept on the edge by its end.
  const double sine_in = in_m > 0 ? glm::length(glm::cross(corner.in, edge.along)) / in_m : 1.0;
  const double sine_out = out_m > 0 ? glm::length(glm::cross(corner.out, edge.along)) / out_m : 1.0;
  wedge.length_m = sine_in * sine_out;
  wedge.own_length_m = wedge.length_m * (in_m + out_m > 0 ? in_m * out_m / (in_m + out_m) : 0.0);
}

/// Notes whether the segment from the last edge, which leaves that at `last_out_rad`, lies in a face of both.  False if the two are rims of
/// one sheet.
template <class Wedge>
bool join_wedges(const DiffractionEdge& last_edge, double last_out_rad, const PathCorner& corner, Wedge& last, const Wedge& next) {
  constexpr double grazing_rad = 1e-3, sheet_rad = 2.0 * std::numbers::pi - 0.01;
  const bool last_first = last_out_rad < grazing_rad, last_second = last_edge.exterior_rad - last_out_rad < grazing_rad;
  const bool first = corner.in_rad < grazing_rad, second = corner.edge.exterior_rad - corner.in_rad < grazing_rad;
  if (!(last_first || last_second) || !(first || second)) return true;
  if (last_edge.exterior_rad > sheet_rad && corner.edge.exterior_rad > sheet_rad) return false;
  last.joins_next = true;
  last.shared_material = last_first ? last.first_material : last.second_material;
  last.next_shared_material = first ? next.first_material : next.second_material;
  return true;
}

/// L of each wedge, from the least deviation to the largest.  reached_m: path length at source, edges, listener.  Returns the product of
/// L by own segments over the product of L by rank.
template <class Wedge>
double rank_lengths(std::span<const double> reached_m, std::span<Wedge> wedges) {
  const std::size_t order = wedges.size();
  double spreading = 1;
  std::array<std::size_t, kMaxDiffractionOrder + 2> left, right;
  for (std::size_t i = 1; i <= order; ++i) left[i] = i - 1, right[i] = i + 1;
  std::array<bool, kMaxDiffractionOrder + 2> done{};
  const auto deviation_of = [&](std::size_t i) { return wedges[i - 1].diffraction.endless().deviation(); };
  for (std::size_t round = 0; round < order; ++round) {
    std::size_t least = 0;
    for (std::size_t i = 1; i <= order; ++i) {
      if (!done[i] && (least == 0 || deviation_of(i) < deviation_of(least))) least = i;
    }
    const double before_m = reached_m[least] - reached_m[left[least]], after_m = reached_m[right[least]] - reached_m[least];
    Wedge& wedge = wedges[least - 1];
    wedge.ranks_by_own_segments = round == 0;
    wedge.length_m =
        round == 0 ? wedge.own_length_m : wedge.length_m * (before_m + after_m > 0 ? before_m * after_m / (before_m + after_m) : 0.0);
    if (wedge.length_m > 0) spreading *= wedge.own_length_m / wedge.length_m;
    done[least] = true;
    if (left[least] >= 1) right[left[least]] = right[least];
    if (right[least] <= order) left[right[least]] = left[least];
  }
  return spreading;
}

}  // namespace

double fermat_point(const DiffractionEdge& edge, glm::dvec3 a, glm::dvec3 b) {
  const glm::dvec3 from_a = a - edge.start, from_b = b - edge.start;
  const double along_a = glm::dot(from_a, edge.along), along_b = glm::dot(from_b, edge.along);
  const double away_a = glm::length(from_a - along_a * edge.along), away_b = glm::length(from_b - along_b * edge.along);
  if (!(away_a + away_b > 0)) return 0.5 * edge.length_m;
  return (along_a * away_b + along_b * away_a) / (away_a + away_b);
}

bool shortest_path(const DiffractionEdges& edges, const EdgeSequence& sequence, glm::dvec3 from, glm::dvec3 to, EdgePath& path) {
  path.sequence = sequence;
  path.from = from;
  path.to = to;
  const auto order = static_cast<std::size_t>(sequence.order);
  for (std::size_t i = 0; i < order; ++i) path.along_m[i] = 0.5 * edges[sequence.edge[i]].length_m;
  place(edges, path);
  sweep(edges, false, path);
  if (order > 1) sweep(edges, false, path);
  path.length_m = length_of(path);
  for (int i = 0; order > 1 && i < 20; ++i) {
    // The error after a step is of the order of its square.
    if (newton_step(edges, path) <= 1e-5 * path.length_m) break;
  }
  bool past_end = false;
  for (std::size_t i = 0; i < order; ++i) {
    past_end = past_end || path.along_m[i] < 0 || path.along_m[i] > edges[sequence.edge[i]].length_m;
    path.along_m[i] = std::clamp(path.along_m[i], 0.0, edges[sequence.edge[i]].length_m);
  }
  if (past_end) {
    const double free_m = path.length_m;
    place(edges, path);
    for (int i = 0; order > 1 && i < 30; ++i) {
      if (sweep(edges, true, path) <= 1e-6 * free_m) break;
    }
    path.length_m = length_of(path);
  }
  for (std::size_t i = 1; i < order; ++i) {
    if (glm::length(path.point[i] - path.point[i - 1]) < 4.0 * edges.clearance_m()) return false;
  }
  return true;
}

EdgePathField::EdgePathField(const DiffractionEdges& edges, const EdgePath& path, bool in_sight) : order_(path.sequence.order) {
  const auto order = static_cast<std::size_t>(order_);
  std::array<double, kMaxDiffractionOrder + 2> reached_m{};  // path length at source, edges, listener
  double last_out_rad = 0;
  for (std::size_t i = 0; i < order; ++i) {
    PathCorner corner(edges[path.sequence.edge[i]], path, i);
    reached_m[i + 1] = reached_m[i] + corner.in_m;
    reached_m[i + 2] = reached_m[i + 1] + corner.out_m;
    valid_ = corner.find_angles(edges.clearance_m());
    if (!valid_) return;
    Wedge& wedge = wedges_[i];
    set_wedge(corner, reached_m[i + 1], path.length_m, order == 1, wedge);
    if (order == 1) {
      wedge.diffraction.set_in_sight(in_sight);
      wedge.own_length_m = wedge.length_m = wedge.diffraction.own_length_m();
    }
    const double deviation = wedge.diffraction.endless().deviation();
    const double deviation_m = wedge.own_length_m * deviation * deviation;
    least_deviation_m_ = i == 0 ? deviation_m : std::min(least_deviation_m_, deviation_m);
    if (i > 0) {
      least_segment_m_ = i == 1 ? corner.in_m : std::min(least_segment_m_, corner.in_m);
      valid_ = join_wedges(edges[path.sequence.edge[i - 1]], last_out_rad, corner, wedges_[i - 1], wedge);
      if (!valid_) return;
    }
    last_out_rad = corner.out_rad;
  }
  if (order > 1) spreading_ = rank_lengths(reached_m, std::span(wedges_).first(order));
}

ComplexLanes EdgePathField::ratio(const EdgeBands& bands) const {
  const WaveLanes& wave = bands.wave;
  ComplexLanes product = {all_lanes(1.f), {}};
  Lanes own_segments_energy = all_lanes(static_cast<float>(spreading_));  // over that of the product
  const auto root_of_two_wave_lengths = [&](double length_m) { return wave.root * static_cast<float>(std::sqrt(2.0 * length_m)); };
  for (std::size_t i = 0; i < static_cast<std::size_t>(order_); ++i) {
    const Wedge& wedge = wedges_[i];
    const FaceLanes &first = bands.face[wedge.first_material], &second = bands.face[wedge.second_material];
    FaceFactorLanes faces{.first = first.reflected, .second = second.reflected, .incidence = all_lanes(1.f)};
    if (i == 0 || !wedges_[i - 1].joins_next) faces.incidence = 1.f - bands.transmitted(wedge.first_material, wedge.second_material);
    product = product * wedge.diffraction.ratio(wave, wedge.length_m, faces);
    if (order_ > 1 && !wedge.ranks_by_own_segments) {
      const WedgeDiffraction& endless = wedge.diffraction.endless();
      const Lanes by_rank = norm(endless.ratio(root_of_two_wave_lengths(wedge.length_m), faces)),
                  by_own = norm(endless.ratio(root_of_two_wave_lengths(wedge.own_length_m), faces));
      own_segments_energy *= choose(by_rank > 0.f, by_own / choose(by_rank > 0.f, by_rank, all_lanes(1.f)), all_lanes(1.f));
    }
    if (wedge.joins_next)
      product =
          (1.f / (1.f + 0.5f * (bands.face[wedge.shared_material].reflected + bands.face[wedge.next_shared_material].reflected))) * product;
  }
  if (order_ == 1) return product;
  const Lanes x = wave.root * static_cast<float>(std::sqrt(2.0 * least_deviation_m_)),
              apart = wave.number * static_cast<float>(least_segment_m_);
  const Lanes exponent = 0.5f * (x / (x + 0.3f)) * (apart / (1.f + apart));
  Lanes own_segments;
  for (std::size_t lane = 0; lane < kLanes; ++lane) own_segments[lane] = std::pow(own_segments_energy[lane], exponent[lane]);
  return own_segments * product;
}

}  // namespace earshot
