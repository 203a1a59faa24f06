// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/result_groups.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/common.hpp>
#include <limits>
#include <map>
#include <set>

#include "evaluation/results/episode_walk.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/generators/house_plan.h"

namespace earshot {
namespace {

constexpr std::string_view kSynthetic = "synth:";

/// A group with its place in tables.
using Group = std::pair<int, std::string>;

Group size_class(double area_m2) {
  constexpr double kStep = 50;
  const int below = static_cast<int>(area_m2 / kStep);
  return {below, fmt::format("{:.0f} to {:.0f} m2", kStep * below, kStep * (below + 1))};
}

Group distance_class(double distance_m) {
  constexpr double kLimits[] = {3, 6, 12};
  double from = 0;
  int place = 0;
  for (const double limit : kLimits) {
    if (distance_m < limit) return {place, fmt::format("{:.0f} to {:.0f} m", from, limit)};
    from = limit;
    ++place;
  }
  return {place, fmt::format("{:.0f} m and more", from)};
}

/// An empty name: the row does not say.
Group group_of(const EvaluationResult::Row& row, GroupBy by) {
  switch (by) {
    case GroupBy::novelty:
      return {row.novelty == "heard" ? 0 : row.novelty == "unheard" ? 1 : 2, row.novelty};
    case GroupBy::kind:
      return {0, row.sound.empty() ? "" : sound_kind(row.sound)};
    case GroupBy::size:
      return row.area_m2 > 0 ? size_class(row.area_m2) : Group{};
    case GroupBy::distance:
      return row.distance_m > 0 ? distance_class(row.distance_m) : Group{};
    case GroupBy::scene:
      return {0, row.scene};
  }
  return {};
}

std::string cell(const Estimate& estimate) { return fmt::format("{:.3f} [{:.3f}, {:.3f}]", estimate.mean, estimate.low, estimate.high); }

}  // namespace

std::string sound_kind(std::string_view sound) {
  if (!sound.starts_with(kSynthetic)) return "recording";
  sound.remove_prefix(kSynthetic.size());
  return std::string(sound.substr(0, sound.find(':')));
}

void note_novelty(EvaluationResult& result, std::span<const std::string> trained) {
  const std::set<std::string, std::less<>> sounds(trained.begin(), trained.end());
  std::set<std::string> kinds;
  for (const std::string& sound : trained) kinds.insert(sound_kind(sound));
  for (EvaluationResult::Row& row : result.episodes)
    row.novelty = sounds.contains(row.sound) ? "heard" : kinds.contains(sound_kind(row.sound)) ? "unheard" : "unheard kind";
}

double floor_area_m2(const std::string& scene, const std::string& scene_root) {
  constexpr std::string_view kHouse = "house:";
  if (scene.starts_with(kHouse))
    return static_cast<double>(resolve_house(parse_house(std::string_view(scene).substr(kHouse.size()))).area_m2);
  const auto loaded = load_scene_under(scene, scene_root);
  glm::vec3 low(std::numeric_limits<float>::max()), high(std::numeric_limits<float>::lowest());
  for (const glm::vec3 vertex : loaded->mesh().vertices) {
    low = glm::min(low, vertex);
    high = glm::max(high, vertex);
  }
  return static_cast<double>(high.x - low.x) * static_cast<double>(high.z - low.z);
}

double FloorAreas::of(const std::string& scene) {
  auto area = areas_m2_.find(scene);
  if (area == areas_m2_.end()) area = areas_m2_.emplace(scene, floor_area_m2(scene, scene_root_)).first;
  return area->second;
}

bool note_places(EvaluationResult& result, const EpisodeSet& set, FloorAreas& areas) {
  const std::size_t episodes = result.episodes.size();
  if (episodes > set.episodes.size() || result.set_hash != set_hash_of_first(set, episodes)) return false;
  if (episodes < set.episodes.size() && result.partial_of != hex64(set.hash)) return false;
  for (std::size_t i = 0; i < episodes; ++i) {
    EvaluationResult::Row& row = result.episodes[i];
    const Episode& episode = set.episodes[i];
    if (row.scene != episode.scene_id || row.id != episode.episode_id) continue;  // a row that was written by hand
    row.area_m2 = areas.of(row.scene);
    row.distance_m = static_cast<double>(episode.geodesic_distance_m);
  }
  return true;
}

bool can_group(const EvaluationResult& result, GroupBy by) {
  return std::ranges::none_of(result.episodes, [&](const auto& row) { return group_of(row, by).second.empty(); });
}

std::vector<std::pair<std::string, EvaluationResult>> groups_of(const EvaluationResult& result, GroupBy by) {
  std::map<Group, EvaluationResult> groups;
  for (const EvaluationResult::Row& row : result.episodes) {
    const Group group = group_of(row, by);
    if (group.second.empty()) {
      const bool of_set = by == GroupBy::size || by == GroupBy::distance;
      throw InputError(result.agent,
                       by == GroupBy::novelty ? "has a result without the list of training sounds"
                       : of_set               ? "has a result whose episode set is not available"
                                              : "has a result without the sounds of its episodes",
                       by == GroupBy::novelty ? "evaluate it again with a --config that has data.train.sounds"
                       : of_set               ? "name the benchmark with --benchmark FILE"
                                              : "evaluate it again with this program");
    }
    groups[group].episodes.push_back(row);
  }
  std::vector<std::pair<std::string, EvaluationResult>> list;
  for (auto& [group, rows] : groups) {
    rows.agent = result.agent;
    list.emplace_back(group.second, std::move(rows));
  }
  return list;
}

std::string groups_text(const std::vector<EvaluationResult>& results, GroupBy by) {
  std::string text = fmt::format("{:<16} {:<28} {:>8} {:>6}  {:<22} {:<22} {:<22}\n", "agent", "group", "episodes", "share", "success",
                                 "when silent", "SPL");
  for (const EvaluationResult& result : results)
    for (const auto& [name, group] : groups_of(result, by))
      text += fmt::format("{:<16} {:<28} {:>8} {:>4.0f} %  {:<22} {:<22} {:<22}\n", result.agent, name, group.episodes.size(),
                          100.0 * static_cast<double>(group.episodes.size()) / static_cast<double>(result.episodes.size()),
                          cell(group.success()), cell(group.success_when_silent()), cell(group.spl()));
  return text;
}

}  // namespace earshot
