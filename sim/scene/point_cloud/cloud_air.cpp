// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/cloud_air.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <unordered_set>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kMaxNarrowReachM = 2;     // that air reaches through passages narrower than the closed width
constexpr double kRoomRadiusM = 0.45;      // of a ball that fits into every room
constexpr int kSmallestRoom = 4;           // the same in voxels, where no room is that large
constexpr int kMaxRadius = 62;             // in voxels: distances are bytes
constexpr std::size_t kMinHoleVoxels = 9;  // air voxels that touch it
constexpr double kMinAirFraction = 0.98;   // of the most air

const std::array<glm::ivec3, 6> kFaceSteps{glm::ivec3(-1, 0, 0), {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}};

template <class Visit>
void for_each_around(glm::ivec3 voxel, Visit visit) {
  for (int z = -1; z <= 1; ++z)
    for (int y = -1; y <= 1; ++y)
      for (int x = -1; x <= 1; ++x)
        if (x != 0 || y != 0 || z != 0) visit(voxel + glm::ivec3(x, y, z));
}

/// Half widths in voxels, ascending.
std::vector<int> closing_radii(double cell_m) {
  std::vector<int> radii;
  for (const int radius : {1, 2, 4, 8, 16, 32, kMaxRadius})
    if (radius <= 2 || 2 * radius * cell_m <= kMaxOpeningM) radii.push_back(radius);
  return radii;
}

/// Whether one of the eight cubes of two voxels that hold the voxel is free of points.
bool fits_cube(const VoxelField& field, glm::ivec3 voxel) {
  for (int corner = 0; corner < 8; ++corner) {
    const glm::ivec3 first = voxel - glm::ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
    bool is_free = true;
    for (int i = 0; i < 8 && is_free; ++i) is_free = field.distance(first + glm::ivec3(i & 1, i >> 1 & 1, i >> 2)) != 0;
    if (is_free) return true;
  }
  return false;
}

/// Distance 0 where points are and in gaps between them.  Returns these voxels.
std::vector<glm::ivec3> mark_solid(const PointVoxels& points, VoxelField& field) {
  std::vector<glm::ivec3> solid, gaps;
  for (const VoxelPoints& voxel : points.voxels) {
    field.set_distance(voxel.cell, 0);
    solid.push_back(voxel.cell);
  }
  for (const VoxelPoints& voxel : points.voxels) {
    for_each_around(voxel.cell, [&](glm::ivec3 near) {
      if (field.distance(near) != 0 && !fits_cube(field, near)) gaps.push_back(near);
    });
  }
  for (const glm::ivec3 gap : gaps) {
    if (field.distance(gap) == 0) continue;
    field.set_distance(gap, 0);
    solid.push_back(gap);
  }
  return solid;
}

/// Octagonal distances up to `largest`: steps over faces and steps over corners in turn.
void grow_distances(std::vector<glm::ivec3> border, int largest, VoxelField& field) {
  std::vector<glm::ivec3> next;
  for (int distance = 1; distance <= largest; ++distance) {
    next.clear();
    const auto take = [&](glm::ivec3 voxel) {
      if (!field.contains(voxel) || field.distance(voxel) != VoxelField::kFar) return;
      field.set_distance(voxel, static_cast<std::uint8_t>(distance));
      next.push_back(voxel);
    };
    for (const glm::ivec3 voxel : border) {
      if (distance % 2 == 0) {
        for_each_around(voxel, take);
      } else {
        for (const glm::ivec3 step : kFaceSteps) take(voxel + step);
      }
    }
    border.swap(next);
  }
}

/// A voxel that a neighbour of the label would take, so many steps away from where its label began.
struct Claim {
  glm::ivec3 voxel;
  VoxelLabel label;
  int steps;
};

/// Rooms and outside take the band between them, from the middle of openings towards the surfaces (a watershed of the distances: Vincent
/// and Soille 1991), so that they meet where openings are narrowest.  Returns the voxels that rooms took.
std::uint64_t grow_back(VoxelField& field, int radius, double cell_m) {
  std::vector<std::vector<Claim>> claims(static_cast<std::size_t>(radius) + 1);
  // A corner of a room is three times the radius away, and narrow places behind furniture some more; what is farther lies within walls.
  const int most_steps = 3 * radius + 3 + static_cast<int>(kMaxNarrowReachM / cell_m);
  const auto claim_around = [&](const Claim& from, int level) {
    for (const glm::ivec3 step : kFaceSteps) {
      const glm::ivec3 near = from.voxel + step;
      if (!field.contains(near)) continue;
      const VoxelLabel label = field.label(near);
      if (label != VoxelLabel::band && label != VoxelLabel::pocket) continue;
      const int distance = std::min<int>(field.distance(near), level);
      claims[static_cast<std::size_t>(distance)].push_back({near, from.label, from.steps + 1});
    }
  };
  field.for_each([&](glm::ivec3 voxel, int distance, VoxelLabel label, int) {
    if (distance == radius + 1 && (label == VoxelLabel::air || label == VoxelLabel::outside)) claim_around({voxel, label, 0}, radius);
  });
  std::uint64_t taken = 0;
  for (int level = radius; level > 0; --level) {
    std::vector<Claim>& queue = claims[static_cast<std::size_t>(level)];
    for (std::size_t at = 0; at < queue.size(); ++at) {
      const Claim claim = queue[at];
      const VoxelLabel before = field.label(claim.voxel);
      if (claim.steps > most_steps || (before != VoxelLabel::band && before != VoxelLabel::pocket)) continue;
      field.set_label(claim.voxel, claim.label);
      taken += claim.label == VoxelLabel::air;
      claim_around(claim, level);
    }
    queue = {};
  }
  return taken;
}

/// Whether a free voxel lies below along an axis.  None does of the first voxel of a free part, in the order of for_each, and of few
/// others.
bool has_free_below(const VoxelField& field, glm::ivec3 voxel) {
  for (int axis = 0; axis < 3; ++axis) {
    glm::ivec3 below = voxel;
    --below[axis];
    if (field.contains(below) && field.label(below) == VoxelLabel::free) return true;
  }
  return false;
}

/// Labels everything for one half width.  room_radius: in voxels.  Returns the voxels of air.
std::uint64_t label_air(VoxelField& field, int radius, int room_radius, double cell_m) {
  field.reset_labels(radius);
  field.flood({0, 0, 0}, VoxelLabel::outside);
  std::vector<glm::ivec3> seeds;
  field.for_each([&](glm::ivec3 voxel, int, VoxelLabel label, int) {
    if (label == VoxelLabel::free && !has_free_below(field, voxel)) seeds.push_back(voxel);
  });
  std::uint64_t air = 0;
  for (const glm::ivec3 seed : seeds) {
    if (field.label(seed) != VoxelLabel::free) continue;
    const VoxelField::Flooded part = field.flood(seed, VoxelLabel::candidate);
    const bool is_room = part.farthest >= room_radius;
    field.flood(seed, is_room ? VoxelLabel::air : VoxelLabel::pocket);
    if (is_room) air += part.count;
  }
  if (air > 0) air += grow_back(field, radius, cell_m);
  return air;
}

/// Groups of air voxels that touch what is not solid; smaller ones are gaps between points.
std::uint64_t count_holes(const VoxelField& field) {
  std::vector<glm::ivec3> rims;
  std::unordered_set<std::uint64_t> left;
  field.for_each([&](glm::ivec3 voxel, int distance, VoxelLabel label, int) {
    if (label != VoxelLabel::air || distance == VoxelField::kFar) return;
    for (const glm::ivec3 step : kFaceSteps) {
      const VoxelLabel beyond = field.label(voxel + step);
      if (beyond == VoxelLabel::air || beyond == VoxelLabel::solid) continue;
      rims.push_back(voxel);
      left.insert(voxel_key(voxel));
      return;
    }
  });
  std::uint64_t holes = 0;
  std::vector<glm::ivec3> stack;
  for (const glm::ivec3 rim : rims) {
    if (left.erase(voxel_key(rim)) == 0) continue;
    std::size_t size = 0;
    stack.assign(1, rim);
    while (!stack.empty()) {
      const glm::ivec3 voxel = stack.back();
      stack.pop_back();
      ++size;
      for_each_around(voxel, [&](glm::ivec3 near) {
        if (left.erase(voxel_key(near)) > 0) stack.push_back(near);
      });
    }
    holes += size >= kMinHoleVoxels;
  }
  return holes;
}

}  // namespace

int air_margin(double cell_m) { return closing_radii(cell_m).back() + 3; }

CloudAir find_cloud_air(const PointVoxels& points, VoxelField& field, const std::string& where) {
  const double cell_m = points.cell_m;
  const std::vector<int> radii = closing_radii(cell_m);
  grow_distances(mark_solid(points, field), radii.back() + 1, field);
  // Distances end behind the largest half width.
  const int usual_room = std::clamp(static_cast<int>(kRoomRadiusM / cell_m), kSmallestRoom, std::max(kSmallestRoom, radii.back() + 1));
  for (const int room_radius : {usual_room, kSmallestRoom}) {
    std::vector<std::uint64_t> air;
    for (const int radius : radii) air.push_back(label_air(field, radius, room_radius, cell_m));
    const std::uint64_t most = *std::ranges::max_element(air);
    if (most == 0) continue;
    std::size_t chosen = 0;
    while (static_cast<double>(air[chosen]) < kMinAirFraction * static_cast<double>(most)) ++chosen;
    label_air(field, radii[chosen], room_radius, cell_m);
    CloudAir found{.closed_width_m = 2 * radii[chosen] * cell_m, .holes = count_holes(field)};
    field.for_each([&](glm::ivec3, int, VoxelLabel label, int count) {
      if (label == VoxelLabel::band || label == VoxelLabel::pocket) found.unseen += static_cast<std::uint64_t>(count);
    });
    return found;
  }
  throw InputError(where,
                   fmt::format("encloses no air: its openings are wider than {:g} m, or its points too sparse for a cell of {:g} m",
                               2 * radii.back() * cell_m, cell_m),
                   "give a larger cell, complete the cloud, a ceiling included, or check its unit (--unit)");
}

}  // namespace earshot
