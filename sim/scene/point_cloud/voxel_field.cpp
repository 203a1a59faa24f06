// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/voxel_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {

VoxelField::VoxelField(glm::ivec3 size, double cell_m, std::string where)
    : size_(size), blocks_((size + kEdge - 1) / kEdge), cell_m_(cell_m), where_(std::move(where)) {
  const std::uint64_t count =
      static_cast<std::uint64_t>(blocks_.x) * static_cast<std::uint64_t>(blocks_.y) * static_cast<std::uint64_t>(blocks_.z);
  if (count > kMaxBlocks)
    throw InputError(where_,
                     fmt::format("spans {} x {} x {} voxels of {:g} m, and at most {} blocks of {} voxels are held", size.x, size.y, size.z,
                                 cell_m_, kMaxBlocks, kVolume),
                     "give a larger cell (--cell, or FILE,cell=METRES), or cut the cloud into parts");
  size_ = blocks_ * kEdge;
  dense_of_.assign(count, kUniform);
  uniform_.assign(count, VoxelLabel::free);
}

glm::ivec3 VoxelField::first_voxel(std::uint32_t block) const {
  const int index = static_cast<int>(block);
  return glm::ivec3(index % blocks_.x, index / blocks_.x % blocks_.y, index / blocks_.x / blocks_.y) * kEdge;
}

void VoxelField::set_distance(glm::ivec3 voxel, std::uint8_t distance) {
  std::uint32_t& dense = dense_of_[block_of(voxel)];
  if (dense == kUniform) {
    if (distance_.size() == kMaxDenseBlocks)
      throw InputError(where_,
                       fmt::format("needs more than {} blocks of {} voxels of {:g} m near its surfaces", kMaxDenseBlocks, kVolume, cell_m_),
                       "give a larger cell (--cell, or FILE,cell=METRES), or cut the cloud into parts");
    dense = static_cast<std::uint32_t>(distance_.size());
    distance_.emplace_back().fill(kFar);
    label_.emplace_back().fill(VoxelLabel::free);
  }
  distance_[dense][place_in_block(voxel)] = distance;
}

void VoxelField::set_label(glm::ivec3 voxel, VoxelLabel label) {
  const std::uint32_t dense = dense_of_[block_of(voxel)];
  EARSHOT_EXPECT(dense != kUniform);
  label_[dense][place_in_block(voxel)] = label;
}

void VoxelField::reset_labels(int band) {
  std::fill(uniform_.begin(), uniform_.end(), VoxelLabel::free);
  for (std::size_t dense = 0; dense < distance_.size(); ++dense) {
    for (std::size_t i = 0; i < kVolume; ++i) {
      const int distance = distance_[dense][i];
      label_[dense][i] = distance == 0 ? VoxelLabel::solid : distance <= band ? VoxelLabel::band : VoxelLabel::free;
    }
  }
}

void VoxelField::take(glm::ivec3 voxel, VoxelLabel from, VoxelLabel to, std::vector<glm::ivec3>& stack) {
  if (!contains(voxel)) return;
  const std::uint32_t block = block_of(voxel), dense = dense_of_[block];
  VoxelLabel& held = dense == kUniform ? uniform_[block] : label_[dense][place_in_block(voxel)];
  if (held != from) return;
  held = to;
  stack.push_back(voxel);
}

/// The face of a block next to `beyond`'s block: one voxel of a block that holds one label, all 64 of another.
void VoxelField::take_face(glm::ivec3 beyond, int axis, VoxelLabel from, VoxelLabel to, std::vector<glm::ivec3>& stack) {
  if (!contains(beyond)) return;
  const std::uint32_t block = block_of(beyond);
  if (dense_of_[block] == kUniform) return take(beyond, from, to, stack);
  const glm::ivec3 first = first_voxel(block);
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (int i = 0; i < kEdge; ++i) {
    for (int j = 0; j < kEdge; ++j) {
      glm::ivec3 voxel = beyond;
      voxel[u] = first[u] + i;
      voxel[v] = first[v] + j;
      take(voxel, from, to, stack);
    }
  }
}

VoxelField::Flooded VoxelField::flood(glm::ivec3 seed, VoxelLabel to) {
  const VoxelLabel from = label(seed);
  EARSHOT_EXPECT(from != to);
  Flooded flooded;
  std::vector<glm::ivec3> stack;
  take(seed, from, to, stack);
  while (!stack.empty()) {
    const glm::ivec3 voxel = stack.back();
    stack.pop_back();
    const std::uint32_t block = block_of(voxel), dense = dense_of_[block];
    const bool is_uniform = dense == kUniform;
    flooded.count += is_uniform ? std::uint64_t{kVolume} : 1;
    flooded.farthest = std::max(flooded.farthest, is_uniform ? kFar : distance_[dense][place_in_block(voxel)]);
    const glm::ivec3 first = is_uniform ? first_voxel(block) : voxel;
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, is_uniform ? kEdge : 1}) {
        glm::ivec3 beyond = first;
        beyond[axis] += step;
        if (is_uniform)
          take_face(beyond, axis, from, to, stack);
        else
          take(beyond, from, to, stack);
      }
    }
  }
  return flooded;
}

}  // namespace earshot
