// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/hole_finder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <tuple>

#include "sim/scene/air_sample.h"
#include "sim/scene/probe_rays.h"

namespace earshot {
namespace {

constexpr std::uint32_t rays = 16384;
constexpr int probes_around = 8, enclosed_from = 5;  // of the perpendicular rays: most of them, one blind side allowed
constexpr int places_along = 48, halvings = 5;

/// Where one ray passed out.
struct Passage {
  glm::vec3 point, direction;
};

/// Distance at which a ray from inside leaves the bounds.
float distance_to_bounds(const Bounds& bounds, glm::vec3 origin, glm::vec3 direction) {
  float nearest_m = std::numeric_limits<float>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    if (direction[axis] == 0) continue;
    const float wall = direction[axis] > 0 ? bounds.upper[axis] : bounds.lower[axis];
    nearest_m = std::min(nearest_m, std::max(0.f, (wall - origin[axis]) / direction[axis]));
  }
  return nearest_m;
}

/// Eight rays at `angle_rad` from `direction`, evenly around it.
std::array<Hit, probes_around> look_around(const Scene& scene, glm::vec3 point, glm::vec3 direction, float angle_rad) {
  const glm::vec3 helper = std::abs(direction.y) < 0.9f ? glm::vec3(0, 1, 0) : glm::vec3(1, 0, 0);
  const glm::vec3 right = glm::normalize(glm::cross(direction, helper)), up = glm::cross(right, direction);
  std::array<Hit, probes_around> hits;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const float turn = (static_cast<float>(i) + 0.5f) * 2.f * std::numbers::pi_v<float> / probes_around;
    const glm::vec3 sideways = std::cos(turn) * right + std::sin(turn) * up;
    hits[i] = scene.rays().intersect(point, std::cos(angle_rad) * direction + std::sin(angle_rad) * sideways);
  }
  return hits;
}

int count_around(const Scene& scene, glm::vec3 point, glm::vec3 direction) {
  const auto hits = look_around(scene, point, direction, 0.5f * std::numbers::pi_v<float>);
  return static_cast<int>(std::count_if(hits.begin(), hits.end(), [](const Hit& hit) { return hit.valid(); }));
}

std::optional<Passage> find_passage(const Scene& scene, glm::vec3 origin, glm::vec3 direction) {
  const float length_m = distance_to_bounds(scene.bounds(), origin, direction);
  const auto at = [&](float fraction) { return origin + direction * (length_m * fraction); };
  int most = 0;
  float best = 0;
  for (int i = places_along; i >= 0 && most < enclosed_from; --i) {
    const float fraction = static_cast<float>(i) / places_along;
    const int hits = count_around(scene, at(fraction), direction);
    if (hits > most) most = hits, best = fraction;
  }
  if (most == 0) return std::nullopt;  // nothing around even at the start: open country, not a hole
  for (float step = 0.5f / places_along; step > std::exp2(-1.f - halvings) / places_along; step *= 0.5f) {
    if (best + step <= 1.f && count_around(scene, at(best + step), direction) >= most) best += step;
  }
  return Passage{at(best), direction};
}

using Cell = std::tuple<int, int, int>;

/// Groups the passages: those in the same or in touching cells belong together.  Group index per passage.
std::vector<int> group(const std::vector<Passage>& passages, float cell_m) {
  std::map<Cell, std::vector<std::size_t>> cells;
  const auto cell_of = [cell_m](glm::vec3 p) {
    return Cell(static_cast<int>(std::floor(p.x / cell_m)), static_cast<int>(std::floor(p.y / cell_m)),
                static_cast<int>(std::floor(p.z / cell_m)));
  };
  for (std::size_t i = 0; i < passages.size(); ++i) cells[cell_of(passages[i].point)].push_back(i);
  std::vector<int> group_of(passages.size(), -1);
  int groups = 0;
  for (std::size_t seed = 0; seed < passages.size(); ++seed) {
    if (group_of[seed] >= 0) continue;
    std::vector<std::size_t> open = {seed};
    group_of[seed] = groups;
    while (!open.empty()) {
      const auto [x, y, z] = cell_of(passages[open.back()].point);
      open.pop_back();
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            const auto found = cells.find({x + dx, y + dy, z + dz});
            if (found == cells.end()) continue;
            for (const std::size_t other : found->second) {
              group_of[other] = groups;
              open.push_back(other);
            }
            cells.erase(found);
          }
        }
      }
    }
    ++groups;
  }
  return group_of;
}

std::vector<std::string> heaviest(const std::map<std::string, double>& weights) {
  std::vector<std::pair<double, std::string>> order;
  for (const auto& [name, weight] : weights) order.emplace_back(-weight, name);
  std::sort(order.begin(), order.end());
  std::vector<std::string> names;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, order.size()); ++i) names.push_back(order[i].second);
  return names;
}

}  // namespace

std::vector<Hole> find_holes(const Scene& scene, std::uint64_t seed, double least_fraction) {
  const AirSample air = sample_air(scene, seed);
  if (air.points.empty()) return {};
  std::vector<Passage> passages;
  for (std::uint32_t ray = 0; ray < rays; ++ray) {
    const glm::vec3 origin = air.points[ray * air.points.size() / rays];
    const glm::vec3 direction = probe::uniform_direction(probe::stream(seed, probe::Use::first_ray, ray).uniform2(0));
    if (scene.rays().intersect(origin, direction).valid()) continue;
    if (const auto passage = find_passage(scene, origin, direction)) passages.push_back(*passage);
  }
  const float diagonal_m = glm::length(scene.bounds().upper - scene.bounds().lower);
  const float cell_m = std::max(0.2f, diagonal_m / 50.f);
  constexpr float rim_angle_rad = 1.2f;
  const std::vector<int> group_of = group(passages, cell_m);

  const TriangleMesh& mesh = scene.mesh();
  std::map<int, Hole> holes;
  std::map<int, std::map<std::string, double>> rims;
  for (std::size_t i = 0; i < passages.size(); ++i) {
    const glm::vec3 point = passages[i].point;
    Hole& hole = holes.try_emplace(group_of[i], Hole{.bounds = {point, point}, .ray_fraction = 0, .rim = {}}).first->second;
    hole.bounds = {glm::min(hole.bounds.lower, point), glm::max(hole.bounds.upper, point)};
    hole.ray_fraction += 1.0 / rays;
    // A thin wall is edge-on to rays in its own plane: seen from a little inside, slanting forward, its rim comes first.
    const glm::vec3 inside = point - 0.5f * cell_m * passages[i].direction;
    for (const Hit& hit : look_around(scene, inside, passages[i].direction, rim_angle_rad)) {
      if (!hit.valid()) continue;
      rims[group_of[i]][mesh.object_names[mesh.triangle_object[hit.triangle]] + " (" +
                        mesh.material_names[mesh.triangle_material[hit.triangle]] + ")"] += cell_m / (cell_m + hit.distance_m);
    }
  }
  std::vector<Hole> result;
  for (auto& [index, hole] : holes) {
    if (hole.ray_fraction < least_fraction) continue;
    hole.rim = heaviest(rims[index]);
    result.push_back(std::move(hole));
  }
  std::stable_sort(result.begin(), result.end(), [](const Hole& a, const Hole& b) { return a.ray_fraction > b.ray_fraction; });
  return result;
}

}  // namespace earshot
