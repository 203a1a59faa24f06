// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/wedge_finder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>

#include "sim/acoustics/geometry/mesh_sides.h"

namespace earshot {
namespace {

constexpr double kDegreeRad = std::numbers::pi / 180.0;
const double kStraight = std::cos(1.0 * kDegreeRad), kSameFace = std::cos(3.0 * kDegreeRad);

/// One mesh edge with its wedge.  `second` is the direction into the second face.
struct Piece {
  std::array<std::uint32_t, 2> vertex;
  glm::dvec3 along, face, second;
  double length_m, exterior_rad;
  std::uint32_t first_material, second_material;
};

/// The same wedge along the other direction.
Piece reversed(const Piece& piece) {
  Piece other = piece;
  std::swap(other.vertex[0], other.vertex[1]);
  std::swap(other.face, other.second);
  std::swap(other.first_material, other.second_material);
  other.along = -piece.along;
  return other;
}

std::optional<Piece> piece_of(const TriangleMesh& mesh, std::span<const MeshSide> sides) {
  const std::uint32_t low = sides[0].low(), high = sides[0].high();
  const glm::dvec3 start(mesh.vertices[low]), span = glm::dvec3(mesh.vertices[high]) - start;
  const double length_m = glm::length(span);
  if (!(length_m > 0)) return std::nullopt;
  const glm::dvec3 along = span / length_m;

  struct Face {
    double angle_rad;
    glm::dvec3 direction;
    std::uint32_t material;
  };
  std::array<Face, 16> faces;  // more at one edge: the first sixteen decide, rays find the rest
  std::size_t count = 0;
  for (const MeshSide& side : sides) {
    if (count == faces.size()) break;
    glm::dvec3 inward = glm::dvec3(mesh.vertices[side.opposite]) - start;
    inward -= glm::dot(inward, along) * along;
    const double height_m = glm::length(inward);
    if (!(height_m > 1e-9 * length_m)) continue;
    faces[count++] = {0, inward / height_m, mesh.triangle_material[side.triangle]};
  }
  if (count == 0) return std::nullopt;
  if (count == 2 && glm::dot(faces[0].direction, faces[1].direction) < std::cos(kMinExteriorRad)) return std::nullopt;  // flat

  const glm::dvec3 x = faces[0].direction, y = glm::cross(along, x);
  for (std::size_t i = 1; i < count; ++i) {
    const double angle = std::atan2(glm::dot(faces[i].direction, y), glm::dot(faces[i].direction, x));
    faces[i].angle_rad = angle < 0 ? angle + 2.0 * std::numbers::pi : angle;
  }
  std::stable_sort(faces.begin(), faces.begin() + static_cast<std::ptrdiff_t>(count),
                   [](const Face& a, const Face& b) { return a.angle_rad < b.angle_rad; });
  // At most one sector is wider than half a turn.  Faces on top of each other leave a sector of zero between them.
  for (std::size_t i = 0; i < count; ++i) {
    const Face& next = faces[(i + 1) % count];
    const double sector =
        i + 1 < count ? next.angle_rad - faces[i].angle_rad : 2.0 * std::numbers::pi - faces[i].angle_rad + faces[0].angle_rad;
    if (sector < kMinExteriorRad) continue;
    return Piece{{low, high}, along, faces[i].direction, next.direction, length_m, sector, faces[i].material, next.material};
  }
  return std::nullopt;
}

std::vector<Piece> find_pieces(const TriangleMesh& mesh) {
  std::vector<Piece> pieces;
  for_each_joint(sorted_sides(mesh), [&](std::span<const MeshSide> sides) {
    if (const auto piece = piece_of(mesh, sides)) pieces.push_back(*piece);
  });
  return pieces;
}

/// Pieces by the vertices at which they end.
class PiecesAtVertex {
 public:
  PiecesAtVertex(const std::vector<Piece>& pieces, std::size_t num_vertices) : begin_(num_vertices + 1, 0), piece_(2 * pieces.size()) {
    for (const Piece& piece : pieces)
      for (const std::uint32_t vertex : piece.vertex) ++begin_[vertex + 1];
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
    for (std::uint32_t i = 0; i < pieces.size(); ++i)
      for (const std::uint32_t vertex : pieces[i].vertex) piece_[next[vertex]++] = i;
  }
  [[nodiscard]] std::span<const std::uint32_t> at(std::uint32_t vertex) const {
    return std::span(piece_).subspan(begin_[vertex], begin_[vertex + 1] - begin_[vertex]);
  }

 private:
  std::vector<std::uint32_t> begin_, piece_;
};

}  // namespace

std::vector<DiffractionEdge> find_wedges(const TriangleMesh& mesh, double least_length_m) {
  const std::vector<Piece> pieces = find_pieces(mesh);
  const PiecesAtVertex index(pieces, mesh.vertices.size());
  std::vector<std::uint32_t> order(pieces.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return pieces[a].length_m > pieces[b].length_m; });

  std::vector<bool> used(pieces.size(), false);
  std::vector<DiffractionEdge> edges;
  for (const std::uint32_t seed : order) {
    if (used[seed]) continue;
    used[seed] = true;
    // Grown at both ends from its longest piece, whose direction and faces all others must share.
    Piece chain = pieces[seed];
    for (int end = 0; end < 2; ++end) {
      for (bool grown = true; grown;) {
        grown = false;
        for (const std::uint32_t other : index.at(chain.vertex[1])) {
          if (used[other]) continue;
          const Piece next = pieces[other].vertex[0] == chain.vertex[1] ? pieces[other] : reversed(pieces[other]);
          if (glm::dot(next.along, chain.along) < kStraight || glm::dot(next.face, chain.face) < kSameFace ||
              glm::dot(next.second, chain.second) < kSameFace) {
            continue;
          }
          used[other] = true;
          chain.vertex[1] = next.vertex[1];
          grown = true;
          break;
        }
      }
      chain = reversed(chain);
    }
    const glm::dvec3 start(mesh.vertices[chain.vertex[0]]), span = glm::dvec3(mesh.vertices[chain.vertex[1]]) - start;
    const double length_m = glm::length(span);
    if (length_m < least_length_m) continue;
    DiffractionEdge edge;
    edge.start = start;
    edge.along = span / length_m;
    edge.length_m = length_m;
    edge.exterior_rad = chain.exterior_rad;
    edge.face = glm::normalize(chain.face - glm::dot(chain.face, edge.along) * edge.along);
    edge.first_normal = glm::cross(edge.along, edge.face);
    const glm::dvec3 second = std::cos(edge.exterior_rad) * edge.face + std::sin(edge.exterior_rad) * edge.first_normal;
    edge.second_normal = glm::cross(second, edge.along);
    edge.first_material = chain.first_material;
    edge.second_material = chain.second_material;
    edges.push_back(edge);
  }
  std::stable_sort(edges.begin(), edges.end(), [](const auto& a, const auto& b) { return a.length_m > b.length_m; });
  return edges;
}

}  // namespace earshot
