// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/fitted_plane.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <utility>

namespace earshot {
namespace {

constexpr int kReach = 2;                // voxels around a face
constexpr std::uint32_t kFewest = 6;     // points of a plane
constexpr int kFewestVoxels = 3;         // that hold them
constexpr double kFlatness = 4;          // the second moment over the smallest one
constexpr double kSmallestCosine = 0.5;  // between the plane's normal and the face's

using Symmetric = std::array<std::array<double, 3>, 3>;

/// Turns the matrix into a diagonal one by Jacobi rotations; columns of the result are its eigenvectors.
Symmetric eigenvectors_of(Symmetric& matrix) {
  Symmetric vectors{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (int sweep = 0; sweep < 12; ++sweep) {
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>(0, 1), {0, 2}, {1, 2}}) {
      if (matrix[p][q] == 0) continue;
      const double theta = (matrix[q][q] - matrix[p][p]) / (2 * matrix[p][q]);
      const double tangent = (theta >= 0 ? 1 : -1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
      const double cosine = 1 / std::sqrt(tangent * tangent + 1), sine = tangent * cosine;
      for (std::size_t k = 0; k < 3; ++k) {
        const double a = matrix[k][p], b = matrix[k][q];
        matrix[k][p] = cosine * a - sine * b;
        matrix[k][q] = sine * a + cosine * b;
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const double a = matrix[p][k], b = matrix[q][k];
        matrix[p][k] = cosine * a - sine * b;
        matrix[q][k] = sine * a + cosine * b;
        const double u = vectors[k][p], v = vectors[k][q];
        vectors[k][p] = cosine * u - sine * v;
        vectors[k][q] = sine * u + cosine * v;
      }
    }
  }
  return vectors;
}

/// Number, sum and products of points relative to a place near them, where the digits are.
struct Moments {
  glm::dvec3 centre;
  double count = 0;
  glm::dvec3 sum{0};
  std::array<double, 6> products{};
  int num_voxels = 0;

  void add(const VoxelPoints& voxel) {
    const double n = voxel.count;
    std::size_t i = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b, ++i)
        products[i] += voxel.products[i] - centre[a] * voxel.sum[b] - centre[b] * voxel.sum[a] + n * centre[a] * centre[b];
    sum += voxel.sum - n * centre;
    count += n;
    ++num_voxels;
  }
  [[nodiscard]] Symmetric covariance() const {
    Symmetric matrix{};
    std::size_t i = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b, ++i) {
        const double value = products[i] / count - sum[a] / count * (sum[b] / count);
        matrix[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)] =
            matrix[static_cast<std::size_t>(b)][static_cast<std::size_t>(a)] = value;
      }
    return matrix;
  }
};

}  // namespace

PlaneFinder::PlaneFinder(const PointVoxels& points, const VoxelField& field) : points_(points), field_(field) {
  index_.reserve(points.voxels.size());
  for (std::uint32_t i = 0; i < points.voxels.size(); ++i) index_.emplace(voxel_key(points.voxels[i].cell), i);
}

const VoxelPoints* PlaneFinder::points_in(glm::ivec3 voxel) const {
  if (field_.distance(voxel) != 0) return nullptr;
  const auto found = index_.find(voxel_key(voxel));
  return found == index_.end() ? nullptr : &points_.voxels[found->second];
}

std::optional<FittedPlane> PlaneFinder::plane_at(glm::ivec3 solid, glm::ivec3 step) const {
  const int axis = step.x != 0 ? 0 : step.y != 0 ? 1 : 2;
  Moments moments{.centre = (glm::dvec3(solid) + 0.5) * points_.cell_m};
  for (int i = -kReach; i <= kReach; ++i) {
    for (int j = -kReach; j <= kReach; ++j) {
      glm::ivec3 column = solid;
      column[(axis + 1) % 3] += i;
      column[(axis + 2) % 3] += j;
      const int slope = std::max(std::abs(i), std::abs(j));
      // The nearest voxel of the column that faces the air, and the one behind it: noise fills two layers.
      for (int k = 0; k <= 2 * slope; ++k) {
        const glm::ivec3 voxel = column + step * (k % 2 == 0 ? -k / 2 : (k + 1) / 2);
        if (field_.label(voxel) != VoxelLabel::solid || field_.label(voxel - step) != VoxelLabel::air) continue;
        if (const VoxelPoints* front = points_in(voxel)) moments.add(*front);
        if (const VoxelPoints* behind = points_in(voxel + step)) moments.add(*behind);
        break;
      }
    }
  }
  if (moments.count < kFewest || moments.num_voxels < kFewestVoxels) return std::nullopt;
  Symmetric matrix = moments.covariance();
  const Symmetric vectors = eigenvectors_of(matrix);
  std::array<std::size_t, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return matrix[a][a] < matrix[b][b]; });
  if (!(matrix[order[1]][order[1]] > kFlatness * matrix[order[0]][order[0]])) return std::nullopt;
  glm::dvec3 normal(vectors[0][order[0]], vectors[1][order[0]], vectors[2][order[0]]);
  const double cosine = glm::dot(normal, glm::dvec3(step));
  if (!(std::fabs(cosine) >= kSmallestCosine)) return std::nullopt;
  if (cosine > 0) normal = -normal;
  return FittedPlane{.normal = normal, .point = moments.centre + moments.sum / moments.count};
}

}  // namespace earshot
