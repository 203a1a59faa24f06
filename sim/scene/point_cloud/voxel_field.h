// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace earshot {

/// What a voxel is.
enum class VoxelLabel : std::uint8_t {
  free,       ///< not flooded yet
  outside,    ///< joined to the border of the grid
  air,        ///< of a room
  candidate,  ///< enclosed, not judged yet
  pocket,     ///< enclosed, too narrow for a room
  band,       ///< close to a surface
  solid       ///< holds points, or closes a gap between such voxels
};

/// A grid of voxels with a distance and a label each.  Blocks of 8 x 8 x 8 voxels that no distance was written to are far from all
/// surfaces: they hold one label and no memory.  Every voxel lies in [0, size).
class VoxelField {
 public:
  static constexpr int kEdge = 8, kVolume = kEdge * kEdge * kEdge;
  static constexpr std::uint8_t kFar = 255;
  /// Limits: 5 bytes for each block of the grid, 1 KB for each that is near a surface.
  static constexpr std::uint64_t kMaxBlocks = std::uint64_t{1} << 24, kMaxDenseBlocks = std::uint64_t{1} << 20;

  /// Throws InputError with `where` for more than kMaxBlocks.  cell_m: for the message.
  VoxelField(glm::ivec3 size, double cell_m, std::string where);

  [[nodiscard]] bool contains(glm::ivec3 voxel) const {
    return voxel.x >= 0 && voxel.y >= 0 && voxel.z >= 0 && voxel.x < size_.x && voxel.y < size_.y && voxel.z < size_.z;
  }
  [[nodiscard]] std::uint8_t distance(glm::ivec3 voxel) const {
    const std::uint32_t dense = dense_of_[block_of(voxel)];
    return dense == kUniform ? kFar : distance_[dense][place_in_block(voxel)];
  }
  /// Throws InputError for more than kMaxDenseBlocks.
  void set_distance(glm::ivec3 voxel, std::uint8_t distance);
  [[nodiscard]] VoxelLabel label(glm::ivec3 voxel) const {
    const std::uint32_t block = block_of(voxel), dense = dense_of_[block];
    return dense == kUniform ? uniform_[block] : label_[dense][place_in_block(voxel)];
  }
  /// In a block that is near a surface.
  void set_label(glm::ivec3 voxel, VoxelLabel label);

  /// All labels anew: solid at distance 0, band up to `band`, free beyond.
  void reset_labels(int band);

  struct Flooded {
    std::uint64_t count = 0;    ///< voxels
    std::uint8_t farthest = 0;  ///< largest distance
  };
  /// Relabels the voxels labelled as `seed` that faces join to it.  Memory: up to 12 bytes for each of these near a surface.
  Flooded flood(glm::ivec3 seed, VoxelLabel to);

  /// Calls visit(voxel, distance, label, count) for every voxel near a surface, and once per block elsewhere, with its first voxel and the
  /// number of voxels; in a fixed order.
  template <class Visit>
  void for_each(Visit visit) const {
    for (std::uint32_t block = 0; block < dense_of_.size(); ++block) {
      const glm::ivec3 first = first_voxel(block);
      const std::uint32_t dense = dense_of_[block];
      if (dense == kUniform) {
        visit(first, kFar, uniform_[block], kVolume);
        continue;
      }
      for (int i = 0; i < kVolume; ++i)
        visit(first + glm::ivec3(i % kEdge, i / kEdge % kEdge, i / kEdge / kEdge), distance_[dense][static_cast<std::size_t>(i)],
              label_[dense][static_cast<std::size_t>(i)], 1);
    }
  }

 private:
  static constexpr std::uint32_t kUniform = 0xFFFFFFFFu;
  // Coordinates are at least 0.
  [[nodiscard]] std::uint32_t block_of(glm::ivec3 voxel) const {
    return static_cast<std::uint32_t>(((voxel.z >> 3) * blocks_.y + (voxel.y >> 3)) * blocks_.x + (voxel.x >> 3));
  }
  [[nodiscard]] static std::size_t place_in_block(glm::ivec3 voxel) {
    return static_cast<std::size_t>((voxel.z & 7) << 6 | (voxel.y & 7) << 3 | (voxel.x & 7));
  }
  [[nodiscard]] glm::ivec3 first_voxel(std::uint32_t block) const;
  /// Relabels a voxel, or its block of one label, if it has the label `from`, and puts it on the stack.
  void take(glm::ivec3 voxel, VoxelLabel from, VoxelLabel to, std::vector<glm::ivec3>& stack);
  void take_face(glm::ivec3 beyond, int axis, VoxelLabel from, VoxelLabel to, std::vector<glm::ivec3>& stack);

  glm::ivec3 size_, blocks_;
  double cell_m_;
  std::string where_;
  std::vector<std::uint32_t> dense_of_;
  std::vector<VoxelLabel> uniform_;
  std::vector<std::array<std::uint8_t, kVolume>> distance_;
  std::vector<std::array<VoxelLabel, kVolume>> label_;
};

}  // namespace earshot
