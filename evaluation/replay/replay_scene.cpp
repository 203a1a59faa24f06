// SPDX-License-Identifier: Apache-2.0
#include "evaluation/replay/replay_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <map>
#include <numeric>
#include <utility>

#include "sim/scene/color.h"
#include "sim/scene/mesh/mesh_simplify.h"
#include "sim/vision/camera_sensor.h"

namespace earshot {
namespace {

constexpr float kCeilingM = 1.9f;   ///< level surfaces further above the floor are ceilings, roofs and tops of wardrobes
constexpr float kHangingM = 2.05f;  ///< geometry that begins further above the floor hangs or belongs to another storey
constexpr float kBelowM = 1.0f;     ///< geometry that ends further below the floor belongs to another storey
constexpr int kMapPx = 640;         ///< longer side of a map
constexpr float kMarginM = 0.5f;    ///< of a map around what is walkable

using Rgb = std::array<std::uint8_t, 3>;
using Part = std::pair<std::uint32_t, std::uint32_t>;  ///< material, object

bool shown(glm::vec3 a, glm::vec3 b, glm::vec3 c, float floor_m) {
  const float low = std::min({a.y, b.y, c.y}), high = std::max({a.y, b.y, c.y});
  if (high < floor_m - kBelowM || low > floor_m + kHangingM) return false;
  const glm::vec3 normal = glm::cross(b - a, c - a);
  const float area = glm::length(normal);
  return !(low > floor_m + kCeilingM && area > 0 && std::fabs(normal.y) > 0.7f * area);
}

float area_of(const TriangleMesh& mesh, std::size_t triangle) {
  const glm::uvec3 t = mesh.triangles[triangle];
  return 0.5f * glm::length(glm::cross(mesh.vertices[t.y] - mesh.vertices[t.x], mesh.vertices[t.z] - mesh.vertices[t.x]));
}

TriangleMesh storey_of(const TriangleMesh& mesh, float floor_m) {
  TriangleMesh storey = mesh;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const glm::uvec3 t = mesh.triangles[i];
    if (!shown(mesh.vertices[t.x], mesh.vertices[t.y], mesh.vertices[t.z], floor_m)) continue;
    storey.triangles[kept] = t;
    storey.triangle_material[kept] = mesh.triangle_material[i];
    storey.triangle_object[kept] = mesh.triangle_object[i];
    ++kept;
  }
  storey.triangles.resize(kept);
  storey.triangle_material.resize(kept);
  storey.triangle_object.resize(kept);
  return storey;
}

/// The triangles that a page shows, by number.
std::vector<std::uint32_t> largest(const TriangleMesh& mesh, std::size_t count) {
  std::vector<std::uint32_t> order(mesh.triangles.size());
  std::iota(order.begin(), order.end(), 0u);
  if (order.size() <= count) return order;
  std::vector<float> areas(order.size());
  for (std::size_t i = 0; i < areas.size(); ++i) areas[i] = area_of(mesh, i);
  std::ranges::stable_sort(order, [&](std::uint32_t a, std::uint32_t b) { return areas[a] > areas[b]; });
  order.resize(count);
  return order;
}

/// Mean colour of each material of each object, linear.
std::map<Part, glm::vec3> colors_of(const TriangleMesh& mesh, const Appearance& looks) {
  std::map<Part, std::pair<glm::vec3, float>> sums;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const float area = area_of(mesh, i) + 1e-9f;
    auto& [sum, weight] = sums.try_emplace({mesh.triangle_material[i], mesh.triangle_object[i]}, glm::vec3(0), 0.f).first->second;
    sum += area * looks.triangle_color[i];
    weight += area;
  }
  std::map<Part, glm::vec3> colors;
  for (const auto& [part, sum] : sums) colors[part] = sum.first / sum.second;
  return colors;
}

}  // namespace

ReplayMesh replay_mesh(const Scene& scene, const Appearance& looks, float floor_m, std::size_t max_triangles) {
  const std::map<Part, glm::vec3> color = colors_of(scene.mesh(), looks);
  const TriangleMesh storey = storey_of(scene.mesh(), floor_m);
  TriangleMesh mesh = storey;
  for (const float deviation_m : {0.01f, 0.03f, 0.1f, 0.3f, 1.f}) {
    if (mesh.triangles.size() <= max_triangles) break;
    mesh = storey;
    simplify_mesh(mesh, deviation_m);
  }
  ReplayMesh page;
  std::vector<std::uint32_t> number(mesh.vertices.size(), ~0u);
  const auto take = [&](std::uint32_t vertex) {
    if (number[vertex] == ~0u) {
      number[vertex] = static_cast<std::uint32_t>(page.vertices.size());
      page.vertices.push_back(mesh.vertices[vertex]);
    }
    return number[vertex];
  };
  for (const std::uint32_t i : largest(mesh, max_triangles)) {
    const glm::uvec3 t = mesh.triangles[i];
    page.triangles.emplace_back(take(t.x), take(t.y), take(t.z));
    const auto found = color.find({mesh.triangle_material[i], mesh.triangle_object[i]});
    const Rgb shade = to_srgb8(found == color.end() ? glm::vec3(0.6f) : found->second);
    page.colors.insert(page.colors.end(), shade.begin(), shade.end());
  }
  return page;
}

ReplayMap replay_map(const EnvScene& env, const Appearance& looks, float floor_m) {
  const Scene& scene = *env.scene;
  const WalkableMap& floor = env.floor->of(env.navmesh);
  ReplayMap map;
  map.low = floor.low() - kMarginM;
  const glm::vec2 size = floor.high() + kMarginM - map.low;
  map.metres_per_px = std::max(0.01f, std::max(size.x, size.y) / static_cast<float>(kMapPx));
  map.width_px = std::max(1, static_cast<int>(size.x / map.metres_per_px));
  map.height_px = std::max(1, static_cast<int>(size.y / map.metres_per_px));
  map.rgb.resize(3 * static_cast<std::size_t>(map.width_px) * static_cast<std::size_t>(map.height_px));
  const TriangleMesh& mesh = scene.mesh();
  constexpr Rgb outside{14, 17, 23}, wall{41, 48, 61};  // of the page
  auto pixel = map.rgb.begin();
  for (int row = 0; row < map.height_px; ++row)
    for (int column = 0; column < map.width_px; ++column) {
      const glm::vec2 at = map.low + map.metres_per_px * glm::vec2(static_cast<float>(column) + 0.5f, static_cast<float>(row) + 0.5f);
      const Hit hit = scene.rays().intersect({at.x, floor_m + kCeilingM, at.y}, {0, -1, 0});
      Rgb shade = outside;
      if (hit.valid() && hit.position.y > floor_m - kBelowM) {
        const glm::uvec3 t = mesh.triangles[hit.triangle];
        const float up = glm::cross(mesh.vertices[t.y] - mesh.vertices[t.x], mesh.vertices[t.z] - mesh.vertices[t.x]).y;
        // A back face: the ray began inside of something solid.
        const bool inside = up < 0;
        const float light = light_on(hit.normal) * (floor.walkable(at.x, at.y, floor_m) ? 1.f : 0.72f);
        shade = inside ? wall : to_srgb8(light * looks.triangle_color[hit.triangle]);
      }
      pixel = std::ranges::copy(shade, pixel).out;
    }
  return map;
}

}  // namespace earshot
