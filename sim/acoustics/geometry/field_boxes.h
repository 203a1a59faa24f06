// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/vec3.hpp>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Equal boxes that fill the bounds of a scene exactly, and in each a lattice of jittered points by which its air is explored.  A value;
/// safe from any thread.  Metres, world axes.
class FieldBoxes {
 public:
  /// Points along each edge of a box: jittered, so the volume of what a wall cuts off is known within about 1 % of the box.
  static constexpr int kPointsPerEdge = 8;
  static constexpr int kPoints = kPointsPerEdge * kPointsPerEdge * kPointsPerEdge;
  /// From the number of a point to that of the next one along each axis.
  static constexpr std::array<int, 3> kStrides{kPointsPerEdge * kPointsPerEdge, kPointsPerEdge, 1};

  FieldBoxes() = default;  ///< none
  /// edge_m: about the edge of the boxes; larger where that would give more than 16,384.
  FieldBoxes(const Bounds& bounds, float edge_m);

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(count_.x) * static_cast<std::size_t>(count_.y) * static_cast<std::size_t>(count_.z);
  }
  [[nodiscard]] glm::ivec3 count() const { return count_; }   ///< along each axis
  [[nodiscard]] glm::vec3 edge_m() const { return edge_m_; }  ///< of each box
  [[nodiscard]] glm::vec3 origin() const { return origin_; }  ///< lower corner of the first box
  /// Number of the box with these indices along the axes, and back.
  [[nodiscard]] std::size_t number_of(const glm::ivec3& index) const {
    return (static_cast<std::size_t>(index.x) * static_cast<std::size_t>(count_.y) + static_cast<std::size_t>(index.y)) *
               static_cast<std::size_t>(count_.z) +
           static_cast<std::size_t>(index.z);
  }
  [[nodiscard]] glm::ivec3 index_of(std::size_t box) const {
    const auto i = static_cast<int>(box);
    return {i / (count_.y * count_.z), i / count_.z % count_.y, i % count_.z};
  }
  /// Indices of the box that holds a point, or of the nearest one to it.
  [[nodiscard]] glm::ivec3 index_at(glm::vec3 point) const {
    return glm::clamp(glm::ivec3(glm::floor((point - origin_) / edge_m_)), glm::ivec3(0), count_ - 1);
  }

  /// Number of a lattice point from its place along the axes, and back.
  static int lattice_number(const glm::ivec3& at) { return (at.x * kPointsPerEdge + at.y) * kPointsPerEdge + at.z; }
  static glm::ivec3 lattice_place(int number) {
    return {number / (kPointsPerEdge * kPointsPerEdge), number / kPointsPerEdge % kPointsPerEdge, number % kPointsPerEdge};
  }
  /// One of the jittered points of a box.
  [[nodiscard]] glm::vec3 lattice_point(const glm::ivec3& index, const glm::ivec3& at) const;
  /// The place in the lattice of the box with these indices where a point lies, or the nearest one to it.
  [[nodiscard]] glm::ivec3 lattice_place_in(const glm::ivec3& index, glm::vec3 point) const {
    return glm::clamp(glm::ivec3((point - origin_) * points_per_m_ - glm::vec3(index * kPointsPerEdge)), 0, kPointsPerEdge - 1);
  }

 private:
  glm::vec3 origin_{0}, edge_m_{1}, points_per_m_{kPointsPerEdge};
  glm::ivec3 count_{0};
};

/// A bit for each lattice point of a box, or for the part round it.
struct PointBits {
  std::array<std::uint64_t, FieldBoxes::kPoints / 64> words{};

  [[nodiscard]] bool test(int number) const { return (words[static_cast<std::size_t>(number) / 64] >> (number % 64) & 1) != 0; }
  void set(int number) { words[static_cast<std::size_t>(number) / 64] |= std::uint64_t{1} << (number % 64); }
  /// Those along z from the points at these places along x and y.
  [[nodiscard]] unsigned row(int x, int y) const {
    static_assert(FieldBoxes::kPointsPerEdge == 8, "a word for each x, a byte for each y");
    return static_cast<unsigned>(words[static_cast<std::size_t>(x)] >> (8 * y) & 0xFF);
  }
};

/// Calls visit(place) for every place from `first` to `last`, both included, in ascending order.
template <class Visit>
void for_each_place(const glm::ivec3& first, const glm::ivec3& last, Visit&& visit) {
  glm::ivec3 place;
  for (place.x = first.x; place.x <= last.x; ++place.x)
    for (place.y = first.y; place.y <= last.y; ++place.y)
      for (place.z = first.z; place.z <= last.z; ++place.z) visit(place);
}

}  // namespace earshot
