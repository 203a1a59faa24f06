#include "sim/acoustics/paths/diffraction_paths.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <numbers>
#include <tuple>

#include "sim/acoustics/paths/edge_growth.h"
#include "sim/acoustics/paths/edge_reflections.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/paths/path_level.h"

namespace earshot {
namespace {

constexpr float kMostRaised = 1.171f;  // past a straight edge, by Fresnel's integrals: 1.4 dB where it passes furthest above the free field
constexpr double kMostBelowBestDb = 30;  // of a path that is still worked out
/// An estimate may be this much too low: Kurze-Anderson at a corner (4.1 dB), and bands below the one it is made at.
constexpr double kMarginDb = 9;

/// Loss of the diffraction at `at` on the way from `before` to `after`.
double estimate_loss_db(double speed_m_per_s, glm::dvec3 before, glm::dvec3 at, glm::dvec3 after) {
  const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
  return kurze_anderson_db(2.0 * detour_m * kRankingHz / speed_m_per_s);
}

/// Level of an arrival, mean over bands, re 1 / (4 pi).
double arrival_level_db(const Arrival& arrival, int num_bands) {
  double sum = 0;
  for (int band = 0; band < num_bands; ++band) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
  return level_db(4.0 * std::numbers::pi * std::sqrt(sum / num_bands));
}

glm::dvec3 mirror(glm::dvec3 point, const DiffractionEdge& edge, glm::dvec3 normal) {
  return point - 2.0 * glm::dot(point - edge.start, normal) * normal;
}

/// Amplitude and phase of the bands of a group.  Returns whether any is above 0.
bool set_bands(const EdgeBands& bands, const ComplexLanes& ratio, double distance_m, Arrival& arrival) {
  const Lanes amplitude = root_of(norm(ratio)) * bands.free_path(distance_m), phase = argument(ratio);
  bool any = false;
  for (int lane = 0; lane < bands.count; ++lane) {
    arrival.amplitude[bands.first + lane] = amplitude[lane];
    arrival.phase_rad[bands.first + lane] = phase[lane];
    any = any || amplitude[lane] > 0.f;
  }
  return any;
}

/// Does the face, which goes on for `width_m` from the edge, end before the point of reflection in its plane?
bool ends_before_reflection(const DiffractionEdge& edge, glm::dvec3 face, glm::dvec3 normal, double width_m, glm::dvec3 source,
                            glm::dvec3 listener) {
  const glm::dvec3 from = source - edge.start, to = listener - edge.start;
  const double from_height_m = glm::dot(from, normal), to_height_m = glm::dot(to, normal);
  if (width_m >= kWideFaceM || from_height_m <= 0 || to_height_m <= 0) return false;
  return glm::dot(to_height_m * from + from_height_m * to, face) > width_m * (from_height_m + to_height_m);
}

/// Index of the direct sound (order 0) or first-order image among `paths`; -1: not there.
int index_of(glm::dvec3 image, int order, glm::vec3 listener, std::span<const Arrival> paths) {
  const glm::dvec3 toward = image - glm::dvec3(listener);
  const double distance_m = glm::length(toward), tolerance_m = 1e-4 * distance_m;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const Arrival& path = paths[i];
    if (path.kind != (order == 0 ? ArrivalKind::direct : ArrivalKind::reflection) || path.order != order) continue;
    if (order == 0) return static_cast<int>(i);
    if (std::abs(path.distance_m - distance_m) < tolerance_m &&
        glm::length(distance_m * glm::dvec3(path.direction) - toward) < 10.0 * tolerance_m)
      return static_cast<int>(i);
  }
  return -1;
}

bool before_in_space(glm::vec3 a, glm::vec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }

}  // namespace

DiffractionCandidates::DiffractionCandidates(const AcousticScene& scene, glm::vec3 source) : source_(source), budget_(scene.config()) {
  if (!scene.plan().diffraction) return;
  bands_ = edge_bands(scene);
  EdgeGrowth growth(scene, source);
  growth.expand(budget_.expansions);
  const std::vector<RankedCandidate> kept = growth.strongest(static_cast<std::size_t>(budget_.sequences));

  // Together what ends with the same edge, in the order of their strongest.
  std::map<std::uint32_t, std::vector<const RankedCandidate*>> by_last_edge;
  std::vector<std::uint32_t> group_order;
  for (const RankedCandidate& ranked : kept) {
    auto& members = by_last_edge[ranked.last_edge()];
    if (members.empty()) group_order.push_back(ranked.last_edge());
    members.push_back(&ranked);
  }
  candidates_.reserve(kept.size());
  for (const std::uint32_t last : group_order) {
    const std::size_t begin = candidates_.size();
    for (const RankedCandidate* ranked : by_last_edge[last]) candidates_.push_back(ranked->candidate);
    const bool single = std::any_of(candidates_.begin() + static_cast<std::ptrdiff_t>(begin), candidates_.end(),
                                    [](const EdgeCandidate& candidate) { return candidate.sequence.order == 1; });
    groups_.push_back({last, begin, candidates_.size(), single});
  }
}

bool DiffractionCandidates::find_path(const AcousticScene& scene, const EdgeCandidate& candidate, glm::vec3 listener, bool in_sight,
                                      double weakest_db, std::span<const Arrival> paths, int& attempts, Found& found) const {
  found.count = 0;
  const DiffractionEdges& edges = *scene.diffraction_edges();
  const EmbreeScene& rays = scene.scene().rays();
  const auto order = static_cast<std::size_t>(candidate.sequence.order);

  // Cheap and generous first.
  const DiffractionEdge& last = edges[candidate.sequence.edge[order - 1]];
  const glm::dvec3 before(candidate.before), end(listener);
  if (!last.in_air(end, edges.clearance_m())) return false;
  const glm::dvec3 diffraction_point = last.at(std::clamp(fermat_point(last, before, end), 0.0, last.length_m));
  const double about_m = candidate.reached_m + glm::length(diffraction_point - before) + glm::length(end - diffraction_point);
  if (about_m > 2.0 * scene.max_path_m()) return false;
  const double estimate_db = -level_db(std::max(about_m, double{kLeastDistanceM})) - candidate.loss_db -
                             estimate_loss_db(scene.speed_of_sound_m_per_s(), before, diffraction_point, end);
  if (estimate_db + kMarginDb < weakest_db) return false;
  if (order == 1 && level_db(largest_ratio(last, before, end) / std::max(about_m, double{kLeastDistanceM})) < weakest_db) return false;
  --attempts;

  // The path itself, always computed from the same end (reciprocity).
  const bool swapped = before_in_space(listener, source_);
  EdgeSequence sequence = candidate.sequence;
  if (swapped) std::reverse(sequence.edge.begin(), sequence.edge.begin() + candidate.sequence.order);
  EdgePath path;
  if (!shortest_path(edges, sequence, glm::dvec3(swapped ? listener : source_), glm::dvec3(swapped ? source_ : listener), path))
    return false;
  const double distance_m = std::max(path.length_m, double{kLeastDistanceM});
  if (distance_m > scene.max_path_m()) return false;

  // The segment at the listener first: it is the one most often blocked.
  const auto air_point = [&](std::size_t i) { return edges.inset_air_point(sequence.edge[i], path.along_m[i]); };
  const glm::vec3 from(path.from), to(path.to);
  if (swapped ? rays.occluded(from, air_point(0)) : rays.occluded(to, air_point(order - 1))) return false;
  if (swapped ? rays.occluded(to, air_point(order - 1)) : rays.occluded(from, air_point(0))) return false;
  for (std::size_t i = 1; i < order; ++i) {
    if (rays.occluded(air_point(i - 1), air_point(i))) return false;
  }
  const EdgePathField field(edges, path, in_sight);
  if (!field.valid()) return false;

  Arrival& arrival = found.arrival[0];
  arrival = Arrival{};
  arrival.kind = ArrivalKind::diffraction;
  arrival.identity = path_identity(arrival.kind, std::span(candidate.sequence.edge).first(order));
  arrival.order = candidate.sequence.order;
  arrival.distance_m = static_cast<float>(distance_m);
  const auto unit = [](glm::dvec3 vector, glm::dvec3 instead) {
    const double length = glm::length(vector);
    return glm::vec3(length > 0 ? vector / length : instead);
  };
  const glm::dvec3 near_source = swapped ? path.point[order - 1] : path.point[0];
  const glm::dvec3 near_listener = swapped ? path.point[0] : path.point[order - 1];
  arrival.direction = unit(near_listener - end, {0, 0, -1});
  arrival.departure = unit(near_source - glm::dvec3(source_), {0, 0, 1});
  if (in_sight) {
    split(last, field.first_edge(), listener, Arrival(arrival), paths, found);
    return found.count > 0;
  }
  for (const EdgeBands& bands : bands_) found.count |= set_bands(bands, field.ratio(bands), distance_m, arrival) ? 1 : 0;
  return found.count > 0;
}

void DiffractionCandidates::split(const DiffractionEdge& edge, const FiniteWedge& wedge, glm::vec3 listener, const Arrival& base,
                                  std::span<const Arrival> paths, Found& found) const {
  struct Part {
    double detour_m;
    int path;  ///< index; -1: none
  };
  const glm::dvec3 source(source_);
  std::array<Part, 3> parts = {{{wedge.detour_m(0), index_of(source, 0, listener, paths)}, {1e9, -1}, {1e9, -1}}};
  if (edge.exterior_rad >= kBluntRad) {
    parts[1] = {wedge.detour_m(2), index_of(mirror(source, edge, edge.first_normal), 1, listener, paths)};
    parts[2] = {wedge.detour_m(3), index_of(mirror(source, edge, edge.second_normal), 1, listener, paths)};
  }
  // On the lit side of a reflection boundary the edge's wave is part of the image, with or without a path of its own here: planes past the
  // candidates and images that are off are the tracers'.  Past the far end of a narrow face there is no image, and the waves of its two
  // edges cancel but for what its width is to the wave.
  const std::array<bool, 3> past = {
      false, ends_before_reflection(edge, edge.face, edge.first_normal, edge.first_width_m, source, glm::dvec3(listener)),
      ends_before_reflection(edge, edge.second_face(), edge.second_normal, edge.second_width_m, source, glm::dvec3(listener))};
  const auto lit = [&](std::size_t i) { return parts[i].path >= 0 || (wedge.endless().weight(i + 1) < 0 && !past[i]); };
  for (std::size_t i = 0; i < 2; ++i) {
    found.arrival[i] = base;
    found.arrival[i].order = i == 0 ? parts[0].path : -1;
  }
  std::array<bool, 2> any{};
  for (const EdgeBands& bands : bands_) {
    const FaceLanes &first = bands.face[edge.first_material], &second = bands.face[edge.second_material];
    const Lanes passed = bands.transmitted(edge.first_material, edge.second_material);
    // The field is linear in the factors of its terms: one sum for the direct sound, one for what belongs to no path.
    std::array<FaceFactorLanes, 2> factors;
    Lanes jump{};
    for (std::size_t i = 0; i < 3; ++i) {
      // Images have the size of their panels (panel_reflection.h); where they have ended the edge's wave goes on, with many rays.
      if (i > 0 && lit(i)) continue;
      const bool ends = i > 0 && budget_.near_boundary_only;
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::size_t band = static_cast<std::size_t>(bands.first) + std::min(lane, static_cast<std::size_t>(bands.count) - 1);
        const double own = ends ? 0.0 : boundary_weight(bands.wave.exact[lane] * parts[i].detour_m / (2.0 * std::numbers::pi));
        const double weight = std::max(own, found.sight_ends[band]);
        if (!(weight > 0)) continue;
        if (i == 0) {
          const bool belongs = parts[0].path >= 0 && own > 0;
          factors[belongs ? 0 : 1].incidence[lane] = static_cast<float>(weight) * (1.f - passed[lane]);
          jump[lane] = belongs ? static_cast<float>(own / weight) / std::max(1.f - passed[lane], 0.01f) : 0.f;
        } else {
          (i == 1 ? factors[1].first : factors[1].second)[lane] =
              static_cast<float>(weight) * (i == 1 ? first.reflected : second.reflected)[lane];
        }
      }
    }
    for (std::size_t i = 0; i < 2; ++i) {
      ComplexLanes sum;
      if (!all_zero(factors[i].incidence) || !all_zero(factors[i].first) || !all_zero(factors[i].second))
        sum = wedge.ratio(bands.wave, wedge.own_length_m(), factors[i]);
      if (i == 0) jump *= root_of(norm(sum));
      any[i] = set_bands(bands, sum, double{base.distance_m}, found.arrival[i]) || any[i];
    }
    for (int lane = 0; lane < bands.count; ++lane) found.jump[static_cast<std::size_t>(bands.first + lane)] = jump[lane];
  }
  for (std::size_t i = 0; i < 2; ++i) {
    if (any[i]) found.arrival[static_cast<std::size_t>(found.count++)] = found.arrival[i];
  }
}

bool DiffractionCandidates::near_boundary(const AcousticScene& scene, const DiffractionEdge& edge, glm::vec3 listener) const {
  const glm::dvec3 from(source_), to(listener);
  const glm::dvec3 point = edge.at(std::clamp(fermat_point(edge, from, to), 0.0, edge.length_m));
  const double most_m =
      glm::length(point - from) + glm::length(to - point) - 0.5 * scene.speed_of_sound_m_per_s() / scene.bands().centre_hz.front();
  if (glm::length(to - from) >= most_m) return true;
  if (budget_.near_boundary_only || edge.exterior_rad < kBluntRad) return false;
  return glm::length(to - mirror(from, edge, edge.first_normal)) >= most_m ||
         glm::length(to - mirror(from, edge, edge.second_normal)) >= most_m;
}

int DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const {
  return find_arrivals(scene, listener, in_line_of_sight(scene, source_, listener), arrivals);
}

int DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight,
                                         std::vector<Arrival>& arrivals) const {
  if (candidates_.empty()) return 0;
  const DiffractionBudget& budget = budget_;

  // The strongest `paths` at the back of `arrivals`, the weakest of them in front.
  const std::size_t first = arrivals.size(), limit = static_cast<std::size_t>(budget.paths);
  const int num_bands = scene.num_bands();
  double best_db = -1e9, weakest_db = -1e9;
  const auto bring_weakest_to_front = [&] {
    std::size_t weakest = first;
    for (std::size_t i = first; i < arrivals.size(); ++i) {
      const double db = arrival_level_db(arrivals[i], num_bands);
      if (i == first || db < weakest_db) weakest = i, weakest_db = db;
    }
    std::swap(arrivals[first], arrivals[weakest]);
  };
  const DiffractionEdges& edges = *scene.diffraction_edges();
  const auto sees_last_edge = [&](const Group& group) {
    const DiffractionEdge& edge = edges[group.last_edge];
    if (!edge.in_air(glm::dvec3(listener), edges.clearance_m())) return false;
    if (!budget.quick) return edges.visible_from(group.last_edge, listener);
    // About where the strongest candidate is diffracted.
    const double along_m = fermat_point(edge, glm::dvec3(candidates_[group.begin].before), glm::dvec3(listener));
    return !scene.scene().rays().occluded(listener, edges.inset_air_point(group.last_edge, along_m));
  };
  // The strongest, of which reflections are looked for.
  struct Base {
    double db;
    const EdgeCandidate* candidate;
  };
  std::array<Base, EdgeReflections::kSequences> base;
  std::size_t num_base = 0;
  const auto note_base = [&](double db, const EdgeCandidate& candidate) {
    if (num_base == base.size() && db <= base.back().db) return;
    std::size_t at = num_base < base.size() ? num_base++ : num_base - 1;
    for (; at > 0 && base[at - 1].db < db; --at) base[at] = base[at - 1];
    base[at] = {db, &candidate};
  };
  Found found;
  std::array<double, kMaxBands> sight_ends{};
  const auto search = [&](bool boundaries_only) {
    int attempts = budget.attempts;
    for (const Group& group : groups_) {
      if (attempts <= 0) break;
      if (in_sight && !group.single) continue;
      if (boundaries_only && !near_boundary(scene, edges[group.last_edge], listener)) continue;
      if (!sees_last_edge(group)) continue;
      for (std::size_t i = group.begin; i < group.end && attempts > 0; ++i) {
        if (in_sight && candidates_[i].sequence.order > 1) continue;
        const bool full = arrivals.size() - first == limit;
        const double least_db = std::max(full ? weakest_db : -1e9, best_db - kMostBelowBestDb);
        if (!find_path(scene, candidates_[i], listener, in_sight, least_db, std::span(arrivals).first(first), attempts, found)) continue;
        for (int band = 0; boundaries_only && band < num_bands; ++band)
          sight_ends[band] = std::max(sight_ends[band], std::clamp((found.jump[band] - 0.2) / 0.15, 0.0, 1.0));
        if (budget.reflections) note_base(arrival_level_db(found.arrival[0], num_bands), candidates_[i]);
        for (const Arrival& arrival : std::span(found.arrival).first(static_cast<std::size_t>(found.count))) {
          const double db = arrival_level_db(arrival, num_bands);
          best_db = std::max(best_db, db);
          if (arrivals.size() - first < limit) {
            arrivals.push_back(arrival);
            if (arrivals.size() - first == limit) bring_weakest_to_front();
          } else if (db > weakest_db) {
            arrivals[first] = arrival;
            bring_weakest_to_front();
          }
        }
      }
    }
  };
  search(in_sight);
  // Where sight is about to end all single edges count, as they do behind that boundary.
  if (in_sight && std::any_of(sight_ends.begin(), sight_ends.end(), [](double weight) { return weight > 0; })) {
    found.sight_ends = sight_ends;
    arrivals.resize(first);
    best_db = weakest_db = -1e9;
    num_base = 0;
    search(false);
  }

  // Until here `order` of an edge wave in sight is the index of the path that it belongs to, or -1.  Earlier ones first,
  // whichever end they were found from: sums get the same bits.
  for (std::size_t i = first + 1; i < arrivals.size(); ++i) {
    const auto before = [](const Arrival& a, const Arrival& b) {
      return a.distance_m != b.distance_m ? a.distance_m < b.distance_m : a.identity < b.identity;
    };
    for (std::size_t j = i; j > first && before(arrivals[j], arrivals[j - 1]); --j) std::swap(arrivals[j], arrivals[j - 1]);
  }
  auto count = static_cast<int>(arrivals.size() - first);
  if (in_sight) {
    std::size_t kept = first;
    std::array<float, kMaxBands> before{};
    const auto direct = std::find_if(arrivals.begin(), arrivals.begin() + static_cast<std::ptrdiff_t>(first),
                                     [](const Arrival& path) { return path.kind == ArrivalKind::direct; });
    const auto has_direct = direct != arrivals.begin() + static_cast<std::ptrdiff_t>(first);
    if (has_direct) before = direct->amplitude;
    for (std::size_t i = first; i < arrivals.size(); ++i) {
      if (arrivals[i].order >= 0) {
        add_wave(bands_, arrivals[i], arrivals[static_cast<std::size_t>(arrivals[i].order)]);
      } else {
        arrivals[i].order = -arrivals[i].order;
        arrivals[kept++] = arrivals[i];
      }
    }
    // Sums over many edges, each as if it were alone, must not raise it above what one does at most.
    for (int band = 0; has_direct && band < num_bands; ++band)
      direct->amplitude[band] = std::min(direct->amplitude[band], kMostRaised * before[band]);
    arrivals.resize(kept);
  }

  cap_at_free_field(num_bands, glm::dvec3(source_), glm::dvec3(listener), std::span(arrivals).subspan(first));
  if (num_base > 0) {
    std::array<EdgeSequence, EdgeReflections::kSequences> sequences;
    for (std::size_t i = 0; i < num_base; ++i) sequences[i] = base[i].candidate->sequence;
    EdgeReflections reflections(scene, bands_, source_, listener, std::span(arrivals).first(first),
                                in_sight ? std::span<const double>(sight_ends) : std::span<const double>());
    for (const Arrival& arrival : reflections.find(std::span(sequences).first(num_base))) {
      ++count;
      if (arrivals.size() - first < limit) {
        arrivals.push_back(arrival);
        continue;
      }
      bring_weakest_to_front();
      if (arrival_level_db(arrival, num_bands) > weakest_db) arrivals[first] = arrival;
    }
  }
  // Insertion sort: few entries, stable, no allocation.
  for (std::size_t i = std::max<std::size_t>(first, 1); i < arrivals.size(); ++i) {
    for (std::size_t j = i; j > 0 && arrivals[j].distance_m < arrivals[j - 1].distance_m; --j) std::swap(arrivals[j], arrivals[j - 1]);
  }
  return count;
}

}  // namespace earshot
