#include "sim/acoustics/paths/diffraction_paths.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <numbers>
#include <tuple>

#include "sim/acoustics/paths/edge_growth.h"
#include "sim/acoustics/paths/line_of_sight.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRankingHz = 500;
constexpr double kMostBelowBestDb = 30;  // of a path that is still worked out
/// An estimate may be this much too low: Kurze-Anderson at a corner (4.1 dB), and bands below the one it is made at.
constexpr double kMarginDb = 9;

/// Loss of the diffraction at `at` on the way from `before` to `after`.
double estimate_loss_db(double speed_m_per_s, glm::dvec3 before, glm::dvec3 at, glm::dvec3 after) {
  const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
  return kurze_anderson_db(2.0 * detour_m * kRankingHz / speed_m_per_s);
}

double level_db(double amplitude) { return 20.0 * std::log10(std::max(amplitude, 1e-12)); }

/// Level of an arrival, mean over bands, re 1 / (4 pi).
double level_db(const Arrival& arrival, int num_bands) {
  double sum = 0;
  for (int band = 0; band < num_bands; ++band) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
  return level_db(4.0 * kPi * std::sqrt(sum / num_bands));
}

bool before_in_space(glm::vec3 a, glm::vec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }

}  // namespace

DiffractionCandidates::DiffractionCandidates(const AcousticScene& scene, glm::vec3 source) : source_(source), budget_(scene.config()) {
  if (scene.diffraction_edges() == nullptr) return;
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
                                      double weakest_db, int& attempts, Arrival& arrival) const {
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
  const auto air_point = [&](std::size_t i) {
    const double length_m = edges[sequence.edge[i]].length_m, inset_m = std::min(2.0 * edges.clearance_m(), 0.5 * length_m);
    return edges.air_point(sequence.edge[i], std::clamp(path.along_m[i], inset_m, length_m - inset_m));
  };
  const glm::vec3 from(path.from), to(path.to);
  if (swapped ? rays.occluded(from, air_point(0)) : rays.occluded(to, air_point(order - 1))) return false;
  if (swapped ? rays.occluded(to, air_point(order - 1)) : rays.occluded(from, air_point(0))) return false;
  for (std::size_t i = 1; i < order; ++i) {
    if (rays.occluded(air_point(i - 1), air_point(i))) return false;
  }
  const EdgePathField field(edges, path, in_sight);
  if (!field.valid()) return false;

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
  bool any = false;
  const bool transmits = scene.plan().straight_transmission;
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double wavenumber = 2.0 * kPi * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
    const auto reflection = [&](std::uint32_t material) {
      return std::sqrt(double{scene.reflectance(material)[band]} * (1.0 - scene.scattering(material)[band]));
    };
    const auto transmission = [&](std::uint32_t material) {
      return transmits ? std::sqrt(double{scene.transmission(material)[band]}) : 0.0;
    };
    const std::complex<double> ratio = field.ratio(wavenumber, reflection, transmission);
    const double air = std::exp(-0.5 * scene.air_energy_per_m()[band] * distance_m);
    // At most 2, and nothing below 1e-154 counts: no need for the care of std::abs.
    arrival.amplitude[band] = static_cast<float>(std::sqrt(std::norm(ratio)) * air / (4.0 * kPi * distance_m));
    arrival.phase_rad[band] = static_cast<float>(std::arg(ratio));
    any = any || arrival.amplitude[band] > 0.f;
  }
  return any;
}

void DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const {
  find_arrivals(scene, listener, in_line_of_sight(scene, source_, listener), arrivals);
}

void DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight,
                                          std::vector<Arrival>& arrivals) const {
  if (candidates_.empty()) return;
  const DiffractionBudget& budget = budget_;
  const bool near_boundary_only = budget.near_boundary_only && in_sight;
  const double sight_m = glm::length(glm::dvec3(listener) - glm::dvec3(source_));
  const double most_detour_m = 0.25 * scene.speed_of_sound_m_per_s() / scene.bands().centre_hz.front();

  // The strongest `paths` at the back of `arrivals`, the weakest of them in front.
  const std::size_t first = arrivals.size(), limit = static_cast<std::size_t>(budget.paths);
  const int num_bands = scene.num_bands();
  double best_db = -1e9, weakest_db = -1e9;
  const auto bring_weakest_to_front = [&] {
    std::size_t weakest = first;
    for (std::size_t i = first; i < arrivals.size(); ++i) {
      const double db = level_db(arrivals[i], num_bands);
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
    const double inset_m = std::min(2.0 * edges.clearance_m(), 0.5 * edge.length_m);
    const double along_m = fermat_point(edge, glm::dvec3(candidates_[group.begin].before), glm::dvec3(listener));
    return !scene.scene().rays().occluded(listener,
                                          edges.air_point(group.last_edge, std::clamp(along_m, inset_m, edge.length_m - inset_m)));
  };
  const auto near_boundary = [&](std::uint32_t edge) {
    const glm::dvec3 diffraction_point =
        edges[edge].at(std::clamp(fermat_point(edges[edge], glm::dvec3(source_), glm::dvec3(listener)), 0.0, edges[edge].length_m));
    return glm::length(diffraction_point - glm::dvec3(source_)) + glm::length(glm::dvec3(listener) - diffraction_point) - sight_m <=
           most_detour_m;
  };
  Arrival arrival;
  int attempts = budget.attempts;
  for (const Group& group : groups_) {
    if (attempts <= 0) break;
    if (near_boundary_only && (!group.single || !near_boundary(group.last_edge))) continue;
    if (!sees_last_edge(group)) continue;
    for (std::size_t i = group.begin; i < group.end && attempts > 0; ++i) {
      if (near_boundary_only && candidates_[i].sequence.order > 1) continue;
      const bool full = arrivals.size() - first == limit;
      const double least_db = std::max(full ? weakest_db : -1e9, best_db - kMostBelowBestDb);
      if (!find_path(scene, candidates_[i], listener, in_sight, least_db, attempts, arrival)) continue;
      const double db = level_db(arrival, num_bands);
      best_db = std::max(best_db, db);
      if (!full) {
        arrivals.push_back(arrival);
        if (arrivals.size() - first == limit) bring_weakest_to_front();
      } else if (db > weakest_db) {
        arrivals[first] = arrival;
        bring_weakest_to_front();
      }
    }
  }

  // Approximations of many edges must not add up to more than there is.
  const double direct_m = std::max(glm::length(glm::dvec3(source_) - glm::dvec3(listener)), double{kLeastDistanceM});
  const double most = 4.0 / (4.0 * kPi * direct_m * 4.0 * kPi * direct_m);
  for (int band = 0; band < num_bands; ++band) {
    double energy = 0;
    for (std::size_t i = first; i < arrivals.size(); ++i) energy += double{arrivals[i].amplitude[band]} * arrivals[i].amplitude[band];
    if (energy <= most) continue;
    const double gain = std::sqrt(most / energy) * (1.0 - 1e-6);
    for (std::size_t i = first; i < arrivals.size(); ++i)
      arrivals[i].amplitude[band] = static_cast<float>(gain * arrivals[i].amplitude[band]);
  }
  // Insertion sort: few entries, stable, no allocation.
  for (std::size_t i = std::max<std::size_t>(first, 1); i < arrivals.size(); ++i) {
    for (std::size_t j = i; j > 0 && arrivals[j].distance_m < arrivals[j - 1].distance_m; --j) std::swap(arrivals[j], arrivals[j - 1]);
  }
}

}  // namespace earshot
