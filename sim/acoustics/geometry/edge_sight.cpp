#include "sim/acoustics/geometry/edge_sight.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace earshot {
namespace {

constexpr std::size_t kMostPairs = std::size_t{1} << 17, kMostBlockers = std::size_t{1} << 18;  // 1 MiB each
constexpr std::size_t kPlaces = 8;  // per point of an edge, about
constexpr float kPlaceM = 2.f;

std::uint64_t mix(std::uint64_t key) {
  key *= 0x9E3779B97F4A7C15ull;
  return key ^ key >> 32;
}

}  // namespace

EdgeSight::EdgeSight(std::size_t num_edges)
    : pairs_(std::min(std::bit_ceil(num_edges * num_edges / 2 + 1), kMostPairs)),
      blockers_(std::min(std::bit_ceil(num_edges * kPointsPerEdge * kPlaces + 1), kMostBlockers)) {
  for (auto& blocker : blockers_) blocker.store(kNothing, std::memory_order_relaxed);
}

std::uint64_t EdgeSight::key_of(std::uint32_t edge, std::uint32_t other) {
  return std::uint64_t{std::min(edge, other)} << 33 | std::uint64_t{std::max(edge, other)} << 2;
}

std::optional<bool> EdgeSight::known(std::uint32_t edge, std::uint32_t other) const {
  const std::uint64_t key = key_of(edge, other), entry = pairs_[mix(key) % pairs_.size()].load(std::memory_order_relaxed);
  if ((entry & ~std::uint64_t{1}) != (key | 2u)) return std::nullopt;
  return (entry & 1u) != 0;
}

void EdgeSight::learn(std::uint32_t edge, std::uint32_t other, bool visible) const {
  const std::uint64_t key = key_of(edge, other);
  pairs_[mix(key) % pairs_.size()].store(key | 2u | (visible ? 1u : 0u), std::memory_order_relaxed);
}

std::atomic<std::uint32_t>& EdgeSight::blocker(std::uint32_t edge, std::uint32_t which, glm::vec3 point) const {
  std::uint64_t key = std::uint64_t{edge} * kPointsPerEdge + which;
  for (int axis = 0; axis < 3; ++axis)
    key = mix(key ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(std::clamp(point[axis] / kPlaceM, -1e6f, 1e6f)))));
  return blockers_[key % blockers_.size()];
}

}  // namespace earshot
