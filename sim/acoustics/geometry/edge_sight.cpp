// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/edge_sight.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace earshot {
namespace {

constexpr std::size_t kMaxGroups = std::size_t{1} << 18, kMaxBlockers = std::size_t{1} << 18;  // 2 MiB and 1 MiB
constexpr std::uint32_t kEdges = (1u << 24) - 1;  // of scenes with more, the rest is not remembered
constexpr std::uint64_t kFacts = 0xFFFF;
constexpr std::size_t kPlaces = 8;  // per point of an edge, about
constexpr float kPlaceM = 2.f;

std::uint64_t mix(std::uint64_t key) {
  key *= 0x9E3779B97F4A7C15ull;
  return key ^ key >> 32;
}

/// Never 0, as entries begin.
std::uint64_t key_of(std::uint32_t edge, std::uint32_t group) { return std::uint64_t{edge + 1} << 40 | std::uint64_t{group} << 16; }

}  // namespace

EdgeSight::EdgeSight(std::size_t num_edges)
    : groups_(std::min(std::bit_ceil(2 * num_edges * (num_edges / kGroup + 1) + 1), kMaxGroups)),
      blockers_(std::min(std::bit_ceil(num_edges * kPointsPerEdge * kPlaces + 1), kMaxBlockers)) {
  for (auto& blocker : blockers_) blocker.store(kNothing, std::memory_order_relaxed);
}

std::atomic<std::uint64_t>& EdgeSight::entry(std::uint64_t key) const {
  // Groups of one edge side by side, as they are asked for.
  return groups_[((mix(key >> 40) >> 8) + (key >> 16 & 0xFFFFFF)) & (groups_.size() - 1)];
}

std::optional<bool> EdgeSight::known(std::uint32_t edge, std::uint32_t other) const {
  if (edge >= kEdges || other >= kEdges) return std::nullopt;
  const std::uint64_t key = key_of(edge, other / kGroup), found = entry(key).load(std::memory_order_relaxed);
  const std::uint64_t bit = std::uint64_t{1} << other % kGroup;
  if ((found & ~kFacts) != key || (found & bit << kGroup) == 0) return std::nullopt;
  return (found & bit) != 0;
}

std::uint32_t EdgeSight::known_hidden(std::uint32_t edge, std::uint32_t group) const {
  if (edge >= kEdges || group >= kEdges / kGroup) return 0;
  const std::uint64_t key = key_of(edge, group), found = entry(key).load(std::memory_order_relaxed);
  if ((found & ~kFacts) != key) return 0;
  return static_cast<std::uint32_t>(found >> kGroup & ~found & 0xFFu);
}

void EdgeSight::learn(std::uint32_t edge, std::uint32_t other, bool visible) const {
  if (edge >= kEdges || other >= kEdges) return;
  for (const auto& [viewer, seen] : {std::pair(edge, other), std::pair(other, edge)}) {
    const std::uint64_t key = key_of(viewer, seen / kGroup), bit = std::uint64_t{1} << seen % kGroup;
    std::atomic<std::uint64_t>& place = entry(key);
    // A concurrent update of another thread may be lost; it is computed again.
    const std::uint64_t found = place.load(std::memory_order_relaxed), facts = (found & ~kFacts) == key ? found & kFacts : 0;
    place.store(key | facts | bit << kGroup | (visible ? bit : 0), std::memory_order_relaxed);
  }
}

std::atomic<std::uint32_t>& EdgeSight::blocker(std::uint32_t edge, std::uint32_t which, glm::vec3 point) const {
  std::uint64_t place = 0;
  for (int axis = 0; axis < 3; ++axis)
    place = mix(place ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(std::clamp(point[axis] / kPlaceM, -1e6f, 1e6f)))));
  return blockers_[(place + std::uint64_t{edge} * kPointsPerEdge + which) & (blockers_.size() - 1)];
}

}  // namespace earshot
