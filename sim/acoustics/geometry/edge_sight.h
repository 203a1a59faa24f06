// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

namespace earshot {

/// Cache of visibility between the edges of a scene, and between edges and points of the air.  A moving source reuses it from pose to pose.
/// Everything here is either certain (whether two edges see each other) or a guess that is tested
/// before it is used (what hides a point of an edge), so the cache changes the time, never an answer.  Bounded: at most
/// 3 MiB.  Any thread may read and write at any time; entries are lost now and then, never wrong.
class EdgeSight {
 public:
  static constexpr std::uint32_t kNothing = 0xFFFFFFFFu;

  explicit EdgeSight(std::size_t num_edges);
  [[nodiscard]] std::size_t bytes() const { return groups_.size() * sizeof(groups_[0]) + blockers_.size() * sizeof(blockers_[0]); }

  /// Do two edges see each other?  nullopt: not known.
  [[nodiscard]] std::optional<bool> known(std::uint32_t edge, std::uint32_t other) const;
  void learn(std::uint32_t edge, std::uint32_t other, bool visible) const;
  /// Of the kGroup edges from group * kGroup on, those of which it is known that `edge` does not see them: a bit each, the first lowest.
  [[nodiscard]] std::uint32_t known_hidden(std::uint32_t edge, std::uint32_t group) const;
  static constexpr std::uint32_t kGroup = 8;

  /// The triangle that may hide point `which` of an edge, below kPointsPerEdge, from `point` and its surroundings; kNothing: no guess.
  [[nodiscard]] std::atomic<std::uint32_t>& blocker(std::uint32_t edge, std::uint32_t which, glm::vec3 point) const;

  static constexpr std::uint32_t kPointsPerEdge = 5;

 private:
  [[nodiscard]] std::atomic<std::uint64_t>& entry(std::uint64_t key) const;

  mutable std::vector<std::atomic<std::uint64_t>> groups_;    ///< edge, group, which are known, which are seen: 24 + 24 + 8 + 8 bits
  mutable std::vector<std::atomic<std::uint32_t>> blockers_;  ///< by edge, point and place of a cube of kPlaceM
};

}  // namespace earshot
