// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/diffraction_paths.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <numbers>
#include <span>
#include <tuple>

#include "sim/acoustics/paths/edge_growth.h"
#include "sim/acoustics/paths/edge_reflections.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/paths/path_level.h"

namespace earshot {
namespace {

constexpr float kMaxRaised = 1.171f;  // past a straight edge, by Fresnel's integrals: 1.4 dB where it passes furthest above the free field
constexpr double kMaxBelowBestDb = 30;  // of a path that is still worked out
/// An estimate may be this much too low: Kurze-Anderson at a corner (4.1 dB), and bands below the one it is made at.
constexpr double kMarginDb = 9;

/// Loss of the diffraction at `at` on the way from `before` to `after`.
double estimate_loss_db(double speed_m_per_s, glm::dvec3 before, glm::dvec3 at, glm::dvec3 after) {
  const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
  return kurze_anderson_db(2.0 * detour_m * kRankingHz / speed_m_per_s);
}

glm::dvec3 mirror(glm::dvec3 point, const DiffractionEdge& edge, glm::dvec3 normal) {
  return point - 2.0 * glm::dot(point - edge.start, normal) * normal;
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

/// Where a term of the wave of an edge is largest: the shadow boundary, or the reflection boundary of the first or second face.
struct TermBoundary {
  double detour_m = 1e9;
  int path = -1;     ///< index of the path that ends there; -1: none
  bool lit = false;  ///< reflections: is the term part of that path?
};

/// Factors of the terms of one wave in a group of bands.  The field is linear in them: one sum for the direct sound, one for what belongs
/// to no path.
struct SplitFactors {
  FaceFactorLanes direct, others;
  Lanes jump{};  ///< of the direct sound, over the amplitude of its sum
};

glm::vec3 unit_or(glm::dvec3 vector, glm::dvec3 instead) {
  const double length = glm::length(vector);
  return glm::vec3(length > 0 ? vector / length : instead);
}

/// Insertion sort of the arrivals from `next` on into those from `lowest` on, which are sorted: few entries, stable, no allocation.
template <class Before>
void insert_sorted(std::size_t lowest, std::size_t next, const Before& before, std::vector<Arrival>& arrivals) {
  for (std::size_t i = next; i < arrivals.size(); ++i)
    for (std::size_t j = i; j > lowest && before(arrivals[j], arrivals[j - 1]); --j) std::swap(arrivals[j], arrivals[j - 1]);
}

bool before_in_space(glm::vec3 a, glm::vec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }

}  // namespace

/// Search for the paths to one listener.
class DiffractionCandidates::Search {
 public:
  /// source: that of the candidates, or a point near it.  `arrivals`: the paths found before, to which those over edges are added.
  Search(const DiffractionCandidates& candidates, const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, bool in_sight,
         std::vector<Arrival>& arrivals)
      : candidates_(candidates),
        scene_(scene),
        edges_(*scene.diffraction_edges()),
        source_(source),
        listener_(listener),
        in_sight_(in_sight),
        swapped_(before_in_space(listener, source)),
        arrivals_(arrivals),
        first_(arrivals.size()),
        limit_(static_cast<std::size_t>(candidates.budget_.paths)) {}

  /// DiffractionCandidates::find_arrivals for this listener.
  int find_arrivals();

 private:
  /// The yield of one candidate: a path, or, in sight, the waves of one edge, each for one path of those found before.
  struct Found {
    int count = 0;
    std::array<Arrival, 2> arrival;        ///< in sight, order is the index of the path that this is added to, or -1
    std::array<double, kMaxBands> jump{};  ///< of the direct sound, over what of it is held back: 1/2 on a shadow boundary
  };
  /// A strong candidate, of which reflections are looked for.
  struct Base {
    double db;
    const EdgeCandidate* candidate;
  };

  [[nodiscard]] std::span<Arrival> paths() const { return std::span(arrivals_).first(first_); }
  [[nodiscard]] bool full() const { return arrivals_.size() - first_ == limit_; }
  [[nodiscard]] double level_of(const Arrival& arrival) const { return level_db(arrival, scene_.num_bands()); }

  /// Looks through all groups, or those whose edge the listener is near a boundary of.
  void search_groups(bool boundaries_only);
  void search_group(const Group& group, bool boundaries_only, int& attempts);
  [[nodiscard]] bool sees_last_edge(const Group& group) const;
  /// Is the way over the edge at most half a wave of the lowest band longer than the straight one, or, if reflections count, than that by
  /// a face?
  [[nodiscard]] bool near_boundary(const DiffractionEdge& edge) const;

  /// Works out the path of one candidate into found_, if it may be louder than `weakest_db`.
  bool find_path(const EdgeCandidate& candidate, double weakest_db, int& attempts);
  /// By an estimate that is cheap and generous: may the candidate bring as much?
  [[nodiscard]] bool may_exceed(double weakest_db, const EdgeCandidate& candidate) const;
  /// The path itself, always computed from the same end (reciprocity).  False if there is none within the length of the RIR.
  bool find_shortest_path(EdgeSequence sequence, EdgePath& path) const;
  [[nodiscard]] bool all_segments_free(const EdgePath& path) const;
  void describe(const EdgeCandidate& candidate, const EdgePath& path, Arrival& arrival) const;

  /// Splits the wave of a single edge, whose place and time are in `base`, by the paths that its terms belong to.
  void split(const DiffractionEdge& edge, const FiniteWedge& wedge, const Arrival& base);
  /// Of direct sound, first and second face.
  [[nodiscard]] std::array<TermBoundary, 3> find_boundaries(const DiffractionEdge& edge, const FiniteWedge& wedge) const;
  [[nodiscard]] SplitFactors weigh_terms(const DiffractionEdge& edge, const EdgeBands& bands,
                                         const std::array<TermBoundary, 3>& boundaries) const;

  /// Keeps the strongest `limit_` at the back of arrivals_, the weakest of them in front.
  void insert(const Arrival& arrival);
  void bring_weakest_to_front();
  void note_base(double db, const EdgeCandidate& candidate);

  /// Adds the waves that belong to paths to them, and takes them out of arrivals_.
  void add_waves_to_paths();
  /// Returns how many there are.
  int add_reflections();

  const DiffractionCandidates& candidates_;
  const AcousticScene& scene_;
  const DiffractionEdges& edges_;
  glm::vec3 source_, listener_;
  bool in_sight_;
  bool swapped_;  ///< paths are worked out from the listener
  std::vector<Arrival>& arrivals_;
  std::size_t first_;  ///< of the paths over edges
  std::size_t limit_;  ///< of their number
  double best_db_ = -1e9, weakest_db_ = -1e9;
  std::array<Base, EdgeReflections::kSequences> base_;  ///< strongest first
  std::size_t num_base_ = 0;
  Found found_;
  std::array<double, kMaxBands> sight_ends_{};    ///< from 0 to 1, on a shadow boundary
  std::array<double, kMaxBands> least_weight_{};  ///< of the terms of single edges in sight
};

DiffractionCandidates::DiffractionCandidates(const AcousticScene& scene, glm::vec3 source) : source_(source), budget_(scene.config()) {
  if (!scene.plan().diffraction) return;
  bands_ = edge_bands(scene);
  if (scene.image_order() > 0 && scene.panel_shapes() != nullptr)
    panels_ = scene.panel_shapes()->largest_from(glm::dvec3(source), budget_.panels);
  has_standing_ = std::ranges::any_of(panels_, [&](std::uint32_t index) { return scene.panel_shapes()->all()[index].stands(); });
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

bool DiffractionCandidates::wave_has_face(const PanelShapes& shapes, std::uint32_t edge, bool first) const {
  const std::uint32_t panel = shapes.of_face(edge, first);
  if (panel == PanelShapes::kNone) return false;
  if (has_wave(panel)) return true;
  // The back of one that has.
  const std::uint32_t other = shapes.of_face(edge, !first);
  return other != PanelShapes::kNone && has_wave(other) && !shapes.all()[panel].faces(glm::dvec3(source_));
}

int DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const {
  return find_arrivals(scene, listener, in_line_of_sight(scene, source_, listener), arrivals);
}

int DiffractionCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight,
                                         std::vector<Arrival>& arrivals) const {
  return find_arrivals_from(scene, source_, listener, in_sight, arrivals);
}

int DiffractionCandidates::find_arrivals_from(const AcousticScene& scene, glm::vec3 point, glm::vec3 listener, bool in_sight,
                                              std::vector<Arrival>& arrivals) const {
  return candidates_.empty() ? 0 : Search(*this, scene, point, listener, in_sight, arrivals).find_arrivals();
}

int DiffractionCandidates::Search::find_arrivals() {
  search_groups(in_sight_);
  // Where sight is about to end all single edges count, as they do behind that boundary.
  if (in_sight_ && std::any_of(sight_ends_.begin(), sight_ends_.end(), [](double weight) { return weight > 0; })) {
    least_weight_ = sight_ends_;
    arrivals_.resize(first_);
    best_db_ = weakest_db_ = -1e9;
    num_base_ = 0;
    search_groups(false);
  }
  // Earlier ones first, whichever end they were found from: sums get the same bits.
  const auto before = [](const Arrival& a, const Arrival& b) {
    return a.distance_m != b.distance_m ? a.distance_m < b.distance_m : a.identity < b.identity;
  };
  insert_sorted(first_, first_, before, arrivals_);
  auto count = static_cast<int>(arrivals_.size() - first_);
  if (in_sight_) add_waves_to_paths();
  cap_at_free_field(scene_.num_bands(), glm::dvec3(source_), glm::dvec3(listener_), std::span(arrivals_).subspan(first_));
  if (num_base_ > 0) count += add_reflections();
  insert_sorted(
      0, first_, [](const Arrival& a, const Arrival& b) { return a.distance_m < b.distance_m; }, arrivals_);
  return count;
}

void DiffractionCandidates::Search::search_groups(bool boundaries_only) {
  int attempts = candidates_.budget_.attempts;
  for (const Group& group : candidates_.groups_) {
    if (attempts <= 0) break;
    if (in_sight_ && !group.single) continue;
    if (boundaries_only && !near_boundary(edges_[group.last_edge])) continue;
    if (sees_last_edge(group)) search_group(group, boundaries_only, attempts);
  }
}

void DiffractionCandidates::Search::search_group(const Group& group, bool boundaries_only, int& attempts) {
  for (std::size_t i = group.begin; i < group.end && attempts > 0; ++i) {
    const EdgeCandidate& candidate = candidates_.candidates_[i];
    if (in_sight_ && candidate.sequence.order > 1) continue;
    const double least_db = std::max(full() ? weakest_db_ : -1e9, best_db_ - kMaxBelowBestDb);
    if (!find_path(candidate, least_db, attempts)) continue;
    for (int band = 0; boundaries_only && band < scene_.num_bands(); ++band)
      sight_ends_[band] = std::max(sight_ends_[band], std::clamp((found_.jump[band] - 0.2) / 0.15, 0.0, 1.0));
    if (candidates_.budget_.reflections) note_base(level_of(found_.arrival[0]), candidate);
    for (const Arrival& arrival : std::span(found_.arrival).first(static_cast<std::size_t>(found_.count))) insert(arrival);
  }
}

bool DiffractionCandidates::Search::sees_last_edge(const Group& group) const {
  const DiffractionEdge& edge = edges_[group.last_edge];
  if (!edge.in_air(glm::dvec3(listener_), edges_.clearance_m())) return false;
  if (!candidates_.budget_.quick) return edges_.visible_from(group.last_edge, listener_);
  // About where the strongest candidate is diffracted.
  const double along_m = fermat_point(edge, glm::dvec3(candidates_.candidates_[group.begin].before), glm::dvec3(listener_));
  return !scene_.scene().rays().occluded(listener_, edges_.inset_air_point(group.last_edge, along_m));
}

bool DiffractionCandidates::Search::near_boundary(const DiffractionEdge& edge) const {
  const glm::dvec3 from(source_), to(listener_);
  const glm::dvec3 point = edge.at(std::clamp(fermat_point(edge, from, to), 0.0, edge.length_m));
  const double most_m =
      glm::length(point - from) + glm::length(to - point) - 0.5 * scene_.speed_of_sound_m_per_s() / scene_.bands().centre_hz.front();
  if (glm::length(to - from) >= most_m) return true;
  if (candidates_.budget_.near_boundary_only || edge.exterior_rad < kBluntRad) return false;
  return glm::length(to - mirror(from, edge, edge.first_normal)) >= most_m ||
         glm::length(to - mirror(from, edge, edge.second_normal)) >= most_m;
}

bool DiffractionCandidates::Search::find_path(const EdgeCandidate& candidate, double weakest_db, int& attempts) {
  found_.count = 0;
  if (!may_exceed(weakest_db, candidate)) return false;
  --attempts;
  EdgePath path;
  if (!find_shortest_path(candidate.sequence, path) || !all_segments_free(path)) return false;
  const EdgePathField field(edges_, path, in_sight_);
  if (!field.valid()) return false;
  Arrival& arrival = found_.arrival[0];
  describe(candidate, path, arrival);
  if (in_sight_) {
    split(edges_[candidate.sequence.edge[0]], field.first_edge(), Arrival(arrival));
    return found_.count > 0;
  }
  const double distance_m = path.distance_m();
  for (const EdgeBands& bands : candidates_.bands_) found_.count |= set_bands(bands, field.ratio(bands), distance_m, arrival) ? 1 : 0;
  return found_.count > 0;
}

bool DiffractionCandidates::Search::may_exceed(double weakest_db, const EdgeCandidate& candidate) const {
  const auto order = static_cast<std::size_t>(candidate.sequence.order);
  const DiffractionEdge& last = edges_[candidate.sequence.edge[order - 1]];
  const glm::dvec3 before(candidate.before), end(listener_);
  if (!last.in_air(end, edges_.clearance_m())) return false;
  const glm::dvec3 diffraction_point = last.at(std::clamp(fermat_point(last, before, end), 0.0, last.length_m));
  const double about_m = candidate.reached_m + glm::length(diffraction_point - before) + glm::length(end - diffraction_point);
  if (about_m > 2.0 * scene_.max_path_m()) return false;
  const double estimate_db = -level_db(std::max(about_m, double{kMinDistanceM})) - candidate.loss_db -
                             estimate_loss_db(scene_.speed_of_sound_m_per_s(), before, diffraction_point, end);
  if (estimate_db + kMarginDb < weakest_db) return false;
  return order != 1 || !(level_db(largest_ratio(last, before, end) / std::max(about_m, double{kMinDistanceM})) < weakest_db);
}

bool DiffractionCandidates::Search::find_shortest_path(EdgeSequence sequence, EdgePath& path) const {
  if (swapped_) std::reverse(sequence.edge.begin(), sequence.edge.begin() + sequence.order);
  const glm::dvec3 from(swapped_ ? listener_ : source_), to(swapped_ ? source_ : listener_);
  return shortest_path(edges_, sequence, from, to, path) && !(path.distance_m() > scene_.max_path_m());
}

bool DiffractionCandidates::Search::all_segments_free(const EdgePath& path) const {
  const EmbreeScene& rays = scene_.scene().rays();
  const auto order = static_cast<std::size_t>(path.sequence.order);
  const auto air_point = [&](std::size_t i) { return edges_.inset_air_point(path.sequence.edge[i], path.along_m[i]); };
  // The segment at the listener first: it is the one most often blocked.
  const glm::vec3 from(path.from), to(path.to);
  if (swapped_ ? rays.occluded(from, air_point(0)) : rays.occluded(to, air_point(order - 1))) return false;
  if (swapped_ ? rays.occluded(to, air_point(order - 1)) : rays.occluded(from, air_point(0))) return false;
  for (std::size_t i = 1; i < order; ++i)
    if (rays.occluded(air_point(i - 1), air_point(i))) return false;
  return true;
}

void DiffractionCandidates::Search::describe(const EdgeCandidate& candidate, const EdgePath& path, Arrival& arrival) const {
  const auto order = static_cast<std::size_t>(candidate.sequence.order);
  arrival = Arrival{};
  arrival.kind = ArrivalKind::diffraction;
  arrival.identity = path_identity(arrival.kind, std::span(candidate.sequence.edge).first(order));
  arrival.order = candidate.sequence.order;
  arrival.distance_m = static_cast<float>(path.distance_m());
  const glm::dvec3 near_source = swapped_ ? path.point[order - 1] : path.point[0];
  const glm::dvec3 near_listener = swapped_ ? path.point[0] : path.point[order - 1];
  arrival.direction = unit_or(near_listener - glm::dvec3(listener_), {0, 0, -1});
  arrival.departure = unit_or(near_source - glm::dvec3(source_), {0, 0, 1});
}

std::array<TermBoundary, 3> DiffractionCandidates::Search::find_boundaries(const DiffractionEdge& edge, const FiniteWedge& wedge) const {
  const glm::dvec3 source(source_), listener(listener_);
  std::array<TermBoundary, 3> boundaries;
  boundaries[0] = {wedge.detour_m(0), index_of(source, 0, listener_, paths())};
  if (edge.exterior_rad >= kBluntRad) {
    boundaries[1] = {wedge.detour_m(2), index_of(mirror(source, edge, edge.first_normal), 1, listener_, paths())};
    boundaries[2] = {wedge.detour_m(3), index_of(mirror(source, edge, edge.second_normal), 1, listener_, paths())};
  }
  // On the lit side of a reflection boundary the edge's wave is part of the image, with or without a path of its own here: planes past the
  // candidates and images that are off are the tracers'.  Past the far end of a narrow face there is no image, and the waves of its two
  // edges cancel but for what its width is to the wave.
  const bool past_first = ends_before_reflection(edge, edge.face, edge.first_normal, edge.first_width_m, source, listener);
  const bool past_second = ends_before_reflection(edge, edge.second_face(), edge.second_normal, edge.second_width_m, source, listener);
  boundaries[1].lit = boundaries[1].path >= 0 || (wedge.endless().weight(2) < 0 && !past_first);
  boundaries[2].lit = boundaries[2].path >= 0 || (wedge.endless().weight(3) < 0 && !past_second);
  return boundaries;
}

SplitFactors DiffractionCandidates::Search::weigh_terms(const DiffractionEdge& edge, const EdgeBands& bands,
                                                        const std::array<TermBoundary, 3>& boundaries) const {
  const FaceLanes &first = bands.face[edge.first_material], &second = bands.face[edge.second_material];
  const Lanes passed = bands.transmitted(edge.first_material, edge.second_material);
  const auto index_in_scene = static_cast<std::uint32_t>(&edge - edges_.edges().data());
  SplitFactors factors;
  for (std::size_t i = 0; i < 3; ++i) {
    // Images have the size of their panels, and the largest panels in the air have waves of their own (panel_reflection.h); where other
    // images have ended the edge's wave goes on, with many rays.
    if (i > 0 && (boundaries[i].lit || candidates_.wave_has_face(*scene_.panel_shapes(), index_in_scene, i == 1))) continue;
    const bool ends = i > 0 && candidates_.budget_.near_boundary_only;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t band = static_cast<std::size_t>(bands.first) + std::min(lane, static_cast<std::size_t>(bands.count) - 1);
      const double band_weight = ends ? 0.0 : boundary_weight(bands.wave.exact[lane] * boundaries[i].detour_m / (2.0 * std::numbers::pi));
      const double weight = std::max(band_weight, least_weight_[band]);
      if (!(weight > 0)) continue;
      if (i == 0) {
        const bool belongs = boundaries[0].path >= 0 && band_weight > 0;
        (belongs ? factors.direct : factors.others).incidence[lane] = static_cast<float>(weight) * (1.f - passed[lane]);
        factors.jump[lane] = belongs ? static_cast<float>(band_weight / weight) / std::max(1.f - passed[lane], 0.01f) : 0.f;
      } else {
        (i == 1 ? factors.others.first : factors.others.second)[lane] =
            static_cast<float>(weight) * (i == 1 ? first.reflected : second.reflected)[lane];
      }
    }
  }
  return factors;
}

void DiffractionCandidates::Search::split(const DiffractionEdge& edge, const FiniteWedge& wedge, const Arrival& base) {
  const std::array<TermBoundary, 3> boundaries = find_boundaries(edge, wedge);
  for (std::size_t i = 0; i < 2; ++i) {
    found_.arrival[i] = base;
    found_.arrival[i].order = i == 0 ? boundaries[0].path : -1;
  }
  std::array<bool, 2> is_audible{};
  for (const EdgeBands& bands : candidates_.bands_) {
    SplitFactors factors = weigh_terms(edge, bands, boundaries);
    for (std::size_t i = 0; i < 2; ++i) {
      const FaceFactorLanes& terms = i == 0 ? factors.direct : factors.others;
      ComplexLanes sum;
      if (!all_zero(terms.incidence) || !all_zero(terms.first) || !all_zero(terms.second))
        sum = wedge.ratio(bands.wave, wedge.own_length_m(), terms);
      if (i == 0) factors.jump *= root_of(norm(sum));
      is_audible[i] = set_bands(bands, sum, double{base.distance_m}, found_.arrival[i]) || is_audible[i];
    }
    for (int lane = 0; lane < bands.count; ++lane) found_.jump[static_cast<std::size_t>(bands.first + lane)] = factors.jump[lane];
  }
  for (std::size_t i = 0; i < 2; ++i)
    if (is_audible[i]) found_.arrival[static_cast<std::size_t>(found_.count++)] = found_.arrival[i];
}

void DiffractionCandidates::Search::insert(const Arrival& arrival) {
  const double db = level_of(arrival);
  best_db_ = std::max(best_db_, db);
  if (!full()) {
    arrivals_.push_back(arrival);
    if (full()) bring_weakest_to_front();
  } else if (db > weakest_db_) {
    arrivals_[first_] = arrival;
    bring_weakest_to_front();
  }
}

void DiffractionCandidates::Search::bring_weakest_to_front() {
  std::size_t weakest = first_;
  for (std::size_t i = first_; i < arrivals_.size(); ++i) {
    const double db = level_of(arrivals_[i]);
    if (i == first_ || db < weakest_db_) weakest = i, weakest_db_ = db;
  }
  std::swap(arrivals_[first_], arrivals_[weakest]);
}

void DiffractionCandidates::Search::note_base(double db, const EdgeCandidate& candidate) {
  if (num_base_ == base_.size() && db <= base_.back().db) return;
  std::size_t at = num_base_ < base_.size() ? num_base_++ : num_base_ - 1;
  for (; at > 0 && base_[at - 1].db < db; --at) base_[at] = base_[at - 1];
  base_[at] = {db, &candidate};
}

void DiffractionCandidates::Search::add_waves_to_paths() {
  const std::span<Arrival> paths_before = paths();
  const auto direct =
      std::find_if(paths_before.begin(), paths_before.end(), [](const Arrival& path) { return path.kind == ArrivalKind::direct; });
  const bool has_direct = direct != paths_before.end();
  const std::array<float, kMaxBands> before = has_direct ? direct->amplitude : std::array<float, kMaxBands>{};
  // `order` of an edge wave in sight is the index of the path that it belongs to, or -1.
  std::size_t kept = first_;
  for (std::size_t i = first_; i < arrivals_.size(); ++i) {
    if (arrivals_[i].order >= 0) {
      add_wave(candidates_.bands_, arrivals_[i], arrivals_[static_cast<std::size_t>(arrivals_[i].order)]);
    } else {
      arrivals_[i].order = -arrivals_[i].order;
      arrivals_[kept++] = arrivals_[i];
    }
  }
  // Sums over many edges, each as if it were alone, must not raise it above what one does at most.
  for (int band = 0; has_direct && band < scene_.num_bands(); ++band)
    direct->amplitude[band] = std::min(direct->amplitude[band], kMaxRaised * before[band]);
  arrivals_.resize(kept);
}

int DiffractionCandidates::Search::add_reflections() {
  std::array<EdgeSequence, EdgeReflections::kSequences> sequences;
  for (std::size_t i = 0; i < num_base_; ++i) sequences[i] = base_[i].candidate->sequence;
  EdgeReflections reflections(scene_, candidates_.bands_, source_, listener_, paths(),
                              in_sight_ ? std::span<const double>(sight_ends_) : std::span<const double>());
  int count = 0;
  for (const Arrival& arrival : reflections.find(std::span(sequences).first(num_base_))) {
    ++count;
    if (arrivals_.size() - first_ < limit_) {
      arrivals_.push_back(arrival);
      continue;
    }
    bring_weakest_to_front();
    if (level_of(arrival) > weakest_db_) arrivals_[first_] = arrival;
  }
  return count;
}

}  // namespace earshot
