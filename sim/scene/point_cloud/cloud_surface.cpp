// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/cloud_surface.h"

#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <unordered_map>

#include "sim/base/random.h"
#include "sim/scene/point_cloud/fitted_plane.h"

namespace earshot {
namespace {

constexpr double kHold = 0.01;     // weight of where a vertex was, beside that of a plane
constexpr double kFarPlane = 2.5;  // voxels from the vertex: not the surface of this face
constexpr double kHalf = 0.45;     // of the solid or the air that a vertex may cross
constexpr int kDeepest = 3;        // voxels looked at behind a face
constexpr int kMembranePasses = 50;
// Of a cell.  Corners of the grid lie in rows: simplification makes needles of exactly no area of them, whose removal opens an edge.
constexpr double kUneven = 1e-3;

/// A corner of the grid on the surface, and what its faces ask of it.
struct SurfaceVertex {
  glm::ivec3 corner;
  glm::dmat3 normals{0};               ///< sum of n n^T
  glm::dvec3 pull{0};                  ///< sum of n (distance of the plane along n)
  glm::dvec3 lower{-0.6}, upper{0.6};  ///< where it may go, in voxels
  int planes = 0;
  bool touches_solid = false;
};

class SurfaceLayer {
 public:
  SurfaceLayer(const PointVoxels& points, const VoxelField& field) : points_(points), field_(field), planes_(points, field) {}

  CloudSurface lay() {
    field_.for_each([&](glm::ivec3 voxel, int distance, VoxelLabel label, int) {
      // Rooms meet other labels near surfaces alone.
      if (label == VoxelLabel::air && distance != VoxelField::kFar) add_faces(voxel);
    });
    place_vertices();
    stretch_membranes();
    cut_quads();
    return std::move(surface_);
  }

 private:
  struct Quad {
    std::array<std::uint32_t, 4> corners;
    bool is_hole;
  };

  void add_faces(glm::ivec3 air) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const int sign : {-1, 1}) {
        glm::ivec3 step(0);
        step[axis] = sign;
        const VoxelLabel beyond = field_.label(air + step);
        if (beyond != VoxelLabel::air) add_face(air, axis, step, beyond != VoxelLabel::solid);
      }
    }
  }

  void add_face(glm::ivec3 air, int axis, glm::ivec3 step, bool is_hole) {
    const bool is_upper = step[axis] > 0;
    glm::ivec3 first = air;
    first[axis] += is_upper ? 1 : 0;
    std::array<std::uint32_t, 4> corners{};
    constexpr std::array<std::array<int, 2>, 4> places{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
    for (std::size_t i = 0; i < 4; ++i) {
      glm::ivec3 corner = first;
      corner[(axis + 1) % 3] += places[i][0];
      corner[(axis + 2) % 3] += places[i][1];
      corners[i] = vertex_at(corner);
    }
    const std::optional<FittedPlane> plane = is_hole ? std::nullopt : planes_.plane_at(air + step, step);
    const double into_solid = kHalf * depth(air + step, step, false), into_air = kHalf * depth(air, -step, true);
    for (const std::uint32_t index : corners) {
      SurfaceVertex& vertex = vertices_[index];
      vertex.touches_solid = vertex.touches_solid || !is_hole;
      double &upper = vertex.upper[axis], &lower = vertex.lower[axis];
      auto& bounds = bounded_[index];
      narrow(upper, is_upper ? into_solid : into_air, bounds[static_cast<std::size_t>(2 * axis)], 1);
      narrow(lower, is_upper ? into_air : into_solid, bounds[static_cast<std::size_t>(2 * axis + 1)], -1);
      if (plane) pull_to(*plane, vertex);
    }
    if (is_upper) std::swap(corners[1], corners[3]);
    quads_.push_back({corners, is_hole});
  }

  /// The first face of an axis sets its bound, the others narrow it.
  static void narrow(double& bound, double limit, bool& is_set, int sign) {
    const double size = is_set ? std::min(sign * bound, limit) : limit;
    bound = sign * size;
    is_set = true;
  }

  [[nodiscard]] int depth(glm::ivec3 voxel, glm::ivec3 step, bool of_air) const {
    int depth = 0;
    while (depth < kDeepest && field_.contains(voxel) && (field_.label(voxel) == VoxelLabel::air) == of_air) {
      ++depth;
      voxel += step;
    }
    return depth;
  }

  std::uint32_t vertex_at(glm::ivec3 corner) {
    const auto [found, is_new] = index_.try_emplace(voxel_key(corner), static_cast<std::uint32_t>(vertices_.size()));
    if (is_new) {
      vertices_.push_back({.corner = corner});
      bounded_.push_back({});
    }
    return found->second;
  }

  void pull_to(const FittedPlane& plane, SurfaceVertex& vertex) const {
    const double distance = glm::dot(plane.normal, plane.point - glm::dvec3(vertex.corner) * points_.cell_m);
    if (std::abs(distance) > kFarPlane * points_.cell_m) return;
    vertex.normals += glm::outerProduct(plane.normal, plane.normal);
    vertex.pull += plane.normal * distance;
    ++vertex.planes;
  }

  void place_vertices() {
    surface_.vertices.reserve(vertices_.size());
    for (const SurfaceVertex& vertex : vertices_) {
      glm::dvec3 place = glm::dvec3(vertex.corner) * points_.cell_m;
      if (vertex.planes > 0) {
        const glm::dvec3 shift = glm::inverse(vertex.normals + glm::dmat3(kHold * vertex.planes)) * vertex.pull;
        place += glm::clamp(shift, vertex.lower * points_.cell_m, vertex.upper * points_.cell_m);
      }
      surface_.vertices.push_back(place + kUneven * points_.cell_m * unevenness(vertex.corner));
    }
  }

  /// In [-1, 1) along each axis.
  static glm::dvec3 unevenness(glm::ivec3 corner) {
    const auto words = philox4x32(
        {static_cast<std::uint32_t>(corner.x), static_cast<std::uint32_t>(corner.y), static_cast<std::uint32_t>(corner.z), 0}, {0, 0});
    return glm::dvec3(words[0], words[1], words[2]) * 0x1p-31 - 1.;
  }

  /// Vertices within closed openings go to the mean of their neighbours.
  void stretch_membranes() {
    std::vector<std::pair<std::uint32_t, std::uint32_t>> links;  // from a vertex that moves
    for (const Quad& quad : quads_) {
      for (std::size_t i = 0; i < 4; ++i) {
        const std::uint32_t a = quad.corners[i], b = quad.corners[(i + 1) % 4];
        if (!vertices_[a].touches_solid) links.emplace_back(a, b);
        if (!vertices_[b].touches_solid) links.emplace_back(b, a);
      }
    }
    std::sort(links.begin(), links.end());
    links.erase(std::unique(links.begin(), links.end()), links.end());
    std::vector<glm::dvec3> moved(links.size());
    for (int pass = 0; pass < kMembranePasses; ++pass) {
      std::size_t num_moved = 0;
      for (std::size_t begin = 0, end = 0; begin < links.size(); begin = end) {
        glm::dvec3 sum(0);
        for (; end < links.size() && links[end].first == links[begin].first; ++end) sum += surface_.vertices[links[end].second];
        moved[num_moved++] = sum / static_cast<double>(end - begin);
      }
      num_moved = 0;
      for (std::size_t i = 0; i < links.size(); ++i)
        if (i == 0 || links[i].first != links[i - 1].first) surface_.vertices[links[i].first] = moved[num_moved++];
    }
  }

  /// Along the shorter diagonal.
  void cut_quads() {
    for (const Quad& quad : quads_) {
      const auto& [a, b, c, d] = quad.corners;
      const auto length = [&](std::uint32_t from, std::uint32_t to) {
        return glm::distance(surface_.vertices[from], surface_.vertices[to]);
      };
      if (length(a, c) <= length(b, d)) {
        surface_.triangles.emplace_back(a, b, c);
        surface_.triangles.emplace_back(a, c, d);
      } else {
        surface_.triangles.emplace_back(a, b, d);
        surface_.triangles.emplace_back(b, c, d);
      }
      surface_.is_hole.insert(surface_.is_hole.end(), 2, quad.is_hole);
    }
  }

  const PointVoxels& points_;
  const VoxelField& field_;
  PlaneFinder planes_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;
  std::vector<SurfaceVertex> vertices_;
  std::vector<std::array<bool, 6>> bounded_;  ///< per vertex, axis and side
  std::vector<Quad> quads_;
  CloudSurface surface_;
};

}  // namespace

CloudSurface lay_surface(const PointVoxels& points, const VoxelField& field) { return SurfaceLayer(points, field).lay(); }

}  // namespace earshot
