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

/// The face of a block next to `beyond`'s block: one voxel of a block that holds one label, all 64 of another.
void VoxelField::push_face(glm::ivec3 beyond, int axis, VoxelLabel from, std::vector<glm::ivec3>& stack) const {
  if (!contains(beyond)) return;
  const std::uint32_t block = block_of(beyond);
  if (dense_of_[block] == kUniform) {
    if (uniform_[block] == from) stack.push_back(beyond);
    return;
  }
  const glm::ivec3 first = first_voxel(block);
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (int i = 0; i < kEdge; ++i) {
    for (int j = 0; j < kEdge; ++j) {
      glm::ivec3 voxel = beyond;
      voxel[u] = first[u] + i;
      voxel[v] = first[v] + j;
      if (label(voxel) == from) stack.push_back(voxel);
    }
  }
}

VoxelField::Flooded VoxelField::flood(glm::ivec3 seed, VoxelLabel to) {
  const VoxelLabel from = label(seed);
  EARSHOT_EXPECT(from != to);
  Flooded flooded;
  std::vector<glm::ivec3> stack{seed};
  while (!stack.empty()) {
    const glm::ivec3 voxel = stack.back();
    stack.pop_back();
    if (label(voxel) != from) continue;
    const std::uint32_t block = block_of(voxel), dense = dense_of_[block];
    if (dense == kUniform) {
      uniform_[block] = to;
      flooded.count += kVolume;
      flooded.farthest = kFar;
      const glm::ivec3 first = first_voxel(block);
      for (int axis = 0; axis < 3; ++axis) {
        for (const int step : {-1, kEdge}) {
          glm::ivec3 beyond = first;
          beyond[axis] += step;
          push_face(beyond, axis, from, stack);
        }
      }
      continue;
    }
    label_[dense][place_in_block(voxel)] = to;
    ++flooded.count;
    flooded.farthest = std::max(flooded.farthest, distance_[dense][place_in_block(voxel)]);
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, 1}) {
        glm::ivec3 next = voxel;
        next[axis] += step;
        if (contains(next) && label(next) == from) stack.push_back(next);
      }
    }
  }
  return flooded;
}

}  // namespace earshot
