// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_growth.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/scene/scene.h"

namespace earshot {
namespace {

double level_db(double amplitude) { return 20.0 * std::log10(amplitude); }

glm::dvec3 nearest_point(const DiffractionEdge& edge, glm::dvec3 point) {
  return edge.at(std::clamp(glm::dot(point - edge.start, edge.along), 0.0, edge.length_m));
}

/// The search without any laziness: of every sequence that is expanded, all links in sight are scored and kept.
struct Exhaustive {
  const AcousticScene& scene;
  const DiffractionEdges& edges = *scene.diffraction_edges();
  std::vector<RankedCandidate> found;
  std::vector<bool> expanded;
  std::uint32_t families = 0;

  void add(EdgeCandidate candidate, std::uint32_t edge, glm::dvec3 after, std::uint32_t family) {
    const double length_m = static_cast<double>(candidate.reached_m) + glm::length(after - glm::dvec3(candidate.before));
    if (length_m > static_cast<double>(scene.max_path_m())) return;
    candidate.sequence.edge[static_cast<std::size_t>(candidate.sequence.order++)] = edge;
    found.push_back(
        {.score_db = 0.5 * level_db(edges[edge].length_m) - level_db(std::max(length_m, 0.01)) - static_cast<double>(candidate.loss_db),
         .family = family,
         .candidate = candidate});
    expanded.push_back(false);
  }
  void grow(EdgeCandidate parent, glm::vec3 source) {
    const std::uint32_t family = families++;
    if (parent.sequence.order == 0) {
      parent.before = source;
      for (std::uint32_t edge = 0; edge < edges.size(); ++edge)
        if (edges.visible_from(edge, source)) add(parent, edge, nearest_point(edges[edge], glm::dvec3(source)), family);
      return;
    }
    const auto path = std::span(parent.sequence.edge).first(static_cast<std::size_t>(parent.sequence.order));
    const DiffractionEdge& last_edge = edges[path.back()];
    const glm::dvec3 before(parent.before);
    for (std::uint32_t next = 0; next < edges.size(); ++next) {
      if (std::ranges::find(path, next) != path.end() || !edges.mutually_visible(path.back(), next)) continue;
      const glm::dvec3 after = nearest_point(edges[next], before);
      if (!last_edge.in_air(after, edges.clearance_m()) || !last_edge.in_air(before, edges.clearance_m())) continue;
      const glm::dvec3 at = last_edge.at(std::clamp(fermat_point(last_edge, before, after), 0.0, last_edge.length_m));
      const double detour_m = glm::length(at - before) + glm::length(after - at) - glm::length(after - before);
      const double half_waves = 2.0 * detour_m * 500.0 / static_cast<double>(scene.speed_of_sound_m_per_s());
      const double loss_db = static_cast<double>(parent.loss_db) + kurze_anderson_db(half_waves);
      if (loss_db > 30 || (std::abs(last_edge.angle_of(before) - last_edge.angle_of(after)) < std::numbers::pi && half_waves > 2.0))
        continue;
      EdgeCandidate child = parent;
      child.before = glm::vec3(at);
      child.reached_m += static_cast<float>(glm::length(at - before));
      child.loss_db = static_cast<float>(loss_db);
      add(child, next, after, family);
    }
  }
  void run(glm::vec3 source, int expansions) {
    grow({}, source);
    for (int i = 0; i < expansions; ++i) {
      std::size_t best = found.size();
      for (std::size_t n = 0; n < found.size(); ++n) {
        const bool open = !expanded[n] && found[n].candidate.sequence.order < scene.config().diffraction_order;
        if (open && (best == found.size() || found[best] < found[n])) best = n;
      }
      if (best == found.size()) return;
      expanded[best] = true;
      grow(EdgeCandidate(found[best].candidate), source);
    }
  }
  std::vector<RankedCandidate> strongest(std::size_t limit) const {
    std::vector<RankedCandidate> single, longer;
    for (const RankedCandidate& ranked : found) (ranked.candidate.sequence.order == 1 ? single : longer).push_back(ranked);
    const auto stronger = [](const RankedCandidate& a, const RankedCandidate& b) { return b < a; };
    std::ranges::sort(single, stronger);
    std::ranges::sort(longer, stronger);
    const std::size_t num_longer = std::min(longer.size(), std::max(limit / 2, limit - std::min(limit, single.size())));
    longer.resize(num_longer);
    single.resize(std::min(single.size(), limit - num_longer));
    single.insert(single.end(), longer.begin(), longer.end());
    std::ranges::sort(single, stronger);
    return single;
  }
};

// Few and many expansions, room for few and for all, one edge at most and several: the lazy search finds what the exhaustive one does.
TEST(EdgeGrowth, FindsWhatAskingForAllFinds) {
  AcousticConfig config;
  const auto house = std::make_shared<const Scene>(load_scene("house:7"));
  for (const int order : {1, 2, 3}) {
    config.diffraction_order = order;
    const AcousticScene scene(house, config);
    ASSERT_NE(scene.diffraction_edges(), nullptr);
    for (const glm::vec3 source : {glm::vec3(2, 1.5f, 2), glm::vec3(4, 1.5f, 6)}) {
      for (const int expansions : {0, 3, 20}) {
        Exhaustive all{.scene = scene, .found = {}, .expanded = {}};
        all.run(source, expansions);
        if (order > 1 && expansions > 3) {
          ASSERT_GT(all.found.size(), 256u);  // more than there is room for below
        }
        for (const std::size_t limit : {std::size_t{1}, std::size_t{15}, std::size_t{256}, std::size_t{100000}}) {
          EdgeGrowth growth(scene, source);
          growth.expand(expansions);
          const auto kept = growth.strongest(limit), expected = all.strongest(limit);
          ASSERT_EQ(kept.size(), expected.size()) << order << ' ' << expansions << ' ' << limit;
          for (std::size_t i = 0; i < kept.size(); ++i) {
            ASSERT_EQ(kept[i].candidate.sequence.edge, expected[i].candidate.sequence.edge) << i;
            ASSERT_EQ(kept[i].score_db, expected[i].score_db) << i;
            ASSERT_EQ(kept[i].candidate.before, expected[i].candidate.before) << i;
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace earshot
