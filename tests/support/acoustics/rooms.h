// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <memory>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/scene/scene.h"

/// Rooms of docs/evidence/oracles.md.  There z is up and the walls are x0, x1, y0, y1, z0 (floor), z1 (ceiling); here y is up.
namespace earshot::rooms {

inline glm::vec3 point(double x, double y, double z) { return {static_cast<float>(x), static_cast<float>(z), static_cast<float>(-y)}; }

inline Air oracle_air() {
  Air air;
  air.speed_of_sound_m_per_s = 343.f;
  return air;
}

/// A quad a, b, c, d as two triangles.
inline void append_quad(TriangleMesh& mesh, std::array<glm::vec3, 4> corner, std::uint32_t material) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), corner.begin(), corner.end());
  for (const glm::uvec3 triangle : {glm::uvec3(0, 1, 2), glm::uvec3(0, 2, 3)}) {
    mesh.triangles.push_back(triangle + glm::uvec3(first));
    mesh.triangle_material.push_back(material);
    mesh.triangle_object.push_back(0);
  }
}

/// The six walls of a box between two corners, facing inward, in oracle axes.
inline void append_box(TriangleMesh& mesh, glm::dvec3 lower, glm::dvec3 upper, std::uint32_t material) {
  const auto at = [&](int i, int j, int k) { return point(i ? upper.x : lower.x, j ? upper.y : lower.y, k ? upper.z : lower.z); };
  append_quad(mesh, {at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)}, material);
  append_quad(mesh, {at(1, 0, 0), at(1, 0, 1), at(1, 1, 1), at(1, 1, 0)}, material);
  append_quad(mesh, {at(0, 0, 0), at(0, 0, 1), at(1, 0, 1), at(1, 0, 0)}, material);
  append_quad(mesh, {at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)}, material);
  append_quad(mesh, {at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)}, material);
  append_quad(mesh, {at(0, 0, 1), at(0, 1, 1), at(1, 1, 1), at(1, 0, 1)}, material);
}

inline std::shared_ptr<const Scene> scene_of(TriangleMesh mesh, std::vector<Material> materials, Air air = oracle_air()) {
  for (std::size_t i = 0; i < materials.size(); ++i) mesh.material_names.push_back("slot_" + std::to_string(i));
  mesh.object_names = {"room_0"};
  return std::make_shared<Scene>("test", std::move(mesh), std::move(materials), air);
}

/// A box of 5 x 4 x 3 with a sheet across it at x = 2.2 from floor to ceiling, closed or with a gap at one end.
inline std::shared_ptr<const Scene> divided_box(double gap_m) {
  TriangleMesh mesh;
  append_box(mesh, {0, 0, 0}, {5, 4, 3}, 0);
  append_quad(mesh, {point(2.2, 0, 0), point(2.2, 4 - gap_m, 0), point(2.2, 4 - gap_m, 3), point(2.2, 0, 3)}, 0);
  return scene_of(mesh, {Material::uniform("wall", 0.2f, 1.f)});
}

/// Box [0, x] x [0, y] x [0, z] with one material slot per wall, in the order of the oracles.  `scale` multiplies all lengths.
inline std::shared_ptr<const Scene> box(double x, double y, double z, const std::array<Material, 6>& walls, double scale = 1,
                                        Air air = oracle_air()) {
  const auto at = [&](int i, int j, int k) { return point(i * x * scale, j * y * scale, k * z * scale); };
  TriangleMesh mesh;
  append_quad(mesh, {at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)}, 0);
  append_quad(mesh, {at(1, 0, 0), at(1, 1, 0), at(1, 1, 1), at(1, 0, 1)}, 1);
  append_quad(mesh, {at(0, 0, 0), at(1, 0, 0), at(1, 0, 1), at(0, 0, 1)}, 2);
  append_quad(mesh, {at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)}, 3);
  append_quad(mesh, {at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)}, 4);
  append_quad(mesh, {at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)}, 5);
  return scene_of(std::move(mesh), {walls.begin(), walls.end()}, air);
}

inline std::array<Material, 6> uniform_walls(double absorption, double scattering) {
  std::array<Material, 6> walls;
  walls.fill(Material::uniform("wall", static_cast<float>(absorption), static_cast<float>(scattering)));
  return walls;
}

/// Of sound, in the oracles.
inline constexpr double kSpeedMPerS = 343.0;

/// SHOE-1: 5 x 4 x 3 m.
inline std::shared_ptr<const Scene> shoe1(double absorption, double scattering, double scale = 1) {
  return box(5, 4, 3, uniform_walls(absorption, scattering), scale);
}
inline glm::vec3 shoe1_source() { return point(1.2, 1.5, 1.1); }
inline glm::vec3 shoe1_listener() { return point(3.8, 2.3, 1.6); }

/// Ground only: a square of 20 km, 10 km away at its nearest edge.
inline std::shared_ptr<const Scene> half_space(double absorption, double scattering) {
  const double r = 1e4;
  TriangleMesh mesh;
  append_quad(mesh, {point(-r, -r, 0), point(r, -r, 0), point(r, r, 0), point(-r, r, 0)}, 0);
  return scene_of(std::move(mesh), {Material::uniform("ground", static_cast<float>(absorption), static_cast<float>(scattering))});
}

inline std::shared_ptr<const Scene> empty() { return scene_of({}, {}); }

/// Everything plain: no air, no early part, no interference near walls, one band, exact last segments.
inline AcousticConfig plain_config() {
  AcousticConfig config;
  config.air_absorption = config.wall_power = Switch::off;
  config.early = Switch::off;
  config.bands = 1;
  config.sh_order = 0;
  config.diffuse_last_segment = false;
  return config;
}

inline double amplitude_db(double ratio) { return 20 * std::log10(ratio); }

inline double total_energy(const EnergyHistogram& histogram, int band = 0) {
  double sum = 0;
  for (const double energy : histogram.band_energy(band)) sum += energy;
  return sum;
}

}  // namespace earshot::rooms
