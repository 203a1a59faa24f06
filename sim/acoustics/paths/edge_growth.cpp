#include "sim/acoustics/paths/edge_growth.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/core/arrival.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRankingHz = 500;
constexpr double kMostLossDb = 30;  // of an estimate, over all edges but the last
constexpr double kLeastLossDb = 5;  // of Kurze-Anderson at one edge, without a detour
constexpr double kRoundingDb = 1e-3;

double level_db(double amplitude) { return 20.0 * std::log10(std::max(amplitude, 1e-12)); }

glm::dvec3 nearest_point(const DiffractionEdge& edge, glm::dvec3 point) {
  return edge.at(std::clamp(glm::dot(point - edge.start, edge.along), 0.0, edge.length_m));
}

}  // namespace

EdgeGrowth::EdgeGrowth(const AcousticScene& scene, glm::vec3 source) : scene_(scene), edges_(*scene.diffraction_edges()), source_(source) {
  for (const DiffractionEdge& edge : edges_.edges()) root_of_length_.push_back(static_cast<float>(std::sqrt(edge.length_m)));
  EdgeCandidate root;
  root.before = source_;
  add_family(root);
}

void EdgeGrowth::add_family(const EdgeCandidate& parent) {
  Family family;
  family.parent = parent;
  family.index = num_families_++;
  const auto path = std::span(parent.sequence.edge).first(static_cast<std::size_t>(parent.sequence.order));
  const glm::dvec3 before(parent.before);
  const DiffractionEdge* last_edge = path.empty() ? nullptr : &edges_[path.back()];
  family.most_db = path.empty() ? kRoundingDb : kRoundingDb - kLeastLossDb - static_cast<double>(parent.loss_db);
  if (last_edge == nullptr || last_edge->in_air(before, edges_.clearance_m())) {
    for (std::uint32_t edge = 0; edge < edges_.size(); ++edge) {
      const glm::dvec3 after = nearest_point(edges_[edge], before);
      if (last_edge != nullptr && !last_edge->in_air(after, edges_.clearance_m())) continue;
      const double length_m = static_cast<double>(parent.reached_m) + glm::length(after - before);
      if (length_m > 1.0001 * static_cast<double>(scene_.max_path_m())) continue;
      if (std::find(path.begin(), path.end(), edge) != path.end()) continue;
      family.links.push_back({root_of_length_[edge] / static_cast<float>(std::max(length_m, double{kLeastDistanceM})), edge});
    }
  }
  if (family.links.empty()) return;
  std::make_heap(family.links.begin(), family.links.end());
  family.best_db = level_db(static_cast<double>(family.links.front().bound)) + family.most_db;
  const int order = parent.sequence.order + 1;
  (order == 1 ? roots_ : order < scene_.config().diffraction_order ? growing_ : full_).families.push_back(std::move(family));
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
    const glm::dvec3 at = last_edge.at(std::clamp(fermat_point(last_edge, before, after), 0.0, last_edge.length_m));
    const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
    const double fresnel_number = 2.0 * detour_m * kRankingHz / static_cast<double>(scene_.speed_of_sound_m_per_s());
    const double loss_db = static_cast<double>(parent.loss_db) + kurze_anderson_db(fresnel_number);
    if (loss_db > kMostLossDb) return false;
    const bool lit = std::abs(last_edge.angle_of(before) - last_edge.angle_of(after)) < kPi;
    if (lit && fresnel_number > 2.0) return false;
    child.before = glm::vec3(at);
    child.reached_m = parent.reached_m + static_cast<float>(glm::length(at - before));
    child.loss_db = static_cast<float>(loss_db);
  }
  const double length_m = static_cast<double>(child.reached_m) + glm::length(after - glm::dvec3(child.before));
  if (length_m > static_cast<double>(scene_.max_path_m())) return false;
  // Long edges first: the frame of a door is passed by many more listeners than the rim of a table.
  ranked.score_db =
      0.5 * level_db(edges_[edge].length_m) - level_db(std::max(length_m, double{kLeastDistanceM})) - static_cast<double>(child.loss_db);
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
