// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/house_detail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace earshot {
namespace {

/// The surface of a grid of cells that fills a box: vertices by grid indices, each face as two triangles with outward normals.
template <class Place>
void append_grid_surface(TriangleMesh& mesh, const std::array<int, 3>& cells, std::uint32_t material, std::uint32_t object,
                         const Place& place) {
  std::map<std::array<int, 3>, std::uint32_t> vertex_of;
  const auto vertex = [&](const std::array<int, 3>& at) {
    const auto [found, is_new] = vertex_of.try_emplace(at, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(place(at));
    return found->second;
  };
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool upper : {false, true})
      for (int i = 0; i < cells[u]; ++i)
        for (int k = 0; k < cells[v]; ++k) {
          std::array<std::uint32_t, 4> corner{};
          for (int c = 0; c < 4; ++c) {
            std::array<int, 3> at{};
            at[axis] = upper ? cells[axis] : 0;
            at[u] = i + (c == 1 || c == 2 ? 1 : 0);
            at[v] = k + (c >= 2 ? 1 : 0);
            corner[c] = vertex(at);
          }
          if (!upper) std::swap(corner[1], corner[3]);
          for (const glm::uvec3 triangle : {glm::uvec3{corner[0], corner[1], corner[2]}, glm::uvec3{corner[0], corner[2], corner[3]}}) {
            mesh.triangles.push_back(triangle);
            mesh.triangle_material.push_back(material);
            mesh.triangle_object.push_back(object);
          }
        }
  }
}

/// A cube whose corners are pulled to the unit sphere, stretched to the box.  Square roots are correctly rounded on every machine.
void append_cushion(TriangleMesh& mesh, glm::vec3 lower, glm::vec3 upper, int cells, std::uint32_t material, std::uint32_t object) {
  const glm::vec3 centre = 0.5f * (lower + upper), radius = 0.5f * (upper - lower);
  append_grid_surface(mesh, {cells, cells, cells}, material, object, [&](const std::array<int, 3>& at) {
    glm::vec3 p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = static_cast<float>(2 * at[axis] - cells) / static_cast<float>(cells);
    const float length = std::sqrt((p.x * p.x + p.y * p.y) + p.z * p.z);
    return glm::vec3(centre.x + radius.x * (p.x / length), centre.y + radius.y * (p.y / length), centre.z + radius.z * (p.z / length));
  });
}

}  // namespace

int longest_side_mm(float detail_m) {
  if (!(detail_m > 0.f)) return 0;
  return std::max(1, static_cast<int>(detail_m * 1000.f) * 7071 / 10000);  // a square's diagonal is 1 / 0.7071 of its side
}

std::vector<int> subdivided(std::span<const int> lines, int side_mm) {
  std::vector<int> result(lines.begin(), lines.end());
  if (side_mm <= 0) return result;
  result.clear();
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    const int gap = lines[i + 1] - lines[i], parts = (gap + side_mm - 1) / side_mm;
    for (int part = 0; part < parts; ++part) result.push_back(lines[i] + gap * part / parts);
  }
  if (!lines.empty()) result.push_back(lines.back());
  return result;
}

void append_furniture(TriangleMesh& mesh, const FurnitureBox& box, int side_mm) {
  const std::uint32_t material = intern(mesh.material_names, box.material), object = intern(mesh.object_names, box.object);
  const glm::vec3 lower{metres(box.x0), metres(box.y0), metres(box.z0)}, upper{metres(box.x1), metres(box.y1), metres(box.z1)};
  if (side_mm <= 0) {
    append_box(mesh, lower, upper, material, object);
    return;
  }
  if (box.shape == FurnitureShape::cushion) {
    const int longest = std::max({box.x1 - box.x0, box.y1 - box.y0, box.z1 - box.z0});
    // A face of the cube spans a quarter of the circumference, at most a factor 2 stretched at its middle.
    append_cushion(mesh, lower, upper, std::clamp(2 * longest / side_mm, 4, 48), material, object);
    return;
  }
  const std::array<std::vector<int>, 3> lines{subdivided(std::array{box.x0, box.x1}, side_mm),
                                              subdivided(std::array{box.y0, box.y1}, side_mm),
                                              subdivided(std::array{box.z0, box.z1}, side_mm)};
  const auto cells = [&](int axis) { return static_cast<int>(lines[axis].size()) - 1; };
  append_grid_surface(mesh, {cells(0), cells(1), cells(2)}, material, object, [&](const std::array<int, 3>& at) {
    return glm::vec3(metres(lines[0][at[0]]), metres(lines[1][at[1]]), metres(lines[2][at[2]]));
  });
}

}  // namespace earshot
