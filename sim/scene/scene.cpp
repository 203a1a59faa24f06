// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <span>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/mesh/flat_patches.h"

namespace earshot {
namespace {

std::uint64_t hash_curve(const CoefficientCurve& curve, std::uint64_t seed) {
  const std::uint64_t points = curve.hz.size();
  seed = hash64(std::as_bytes(std::span(&points, 1)), seed);
  seed = hash64(std::as_bytes(std::span(curve.hz)), seed);
  return hash64(std::as_bytes(std::span(curve.value)), seed);
}

std::uint64_t hash_scene(const TriangleMesh& mesh, const std::vector<Material>& materials, const Air& air) {
  std::uint64_t hash = hash_of(mesh);
  for (const Material& material : materials) {
    hash = hash64(material.name, hash);
    for (const CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission, &material.damping_db_per_m}) {
      hash = hash_curve(*curve, hash);
    }
    const float inside[2] = {material.speed_m_per_s, material.density_kg_per_m3};
    hash = hash64(std::as_bytes(std::span(inside)), hash);
    if (!material.locally_reacting) continue;
    hash = hash64("locally reacting", hash);
    for (const CoefficientCurve* curve : {&material.impedance_real, &material.impedance_imaginary}) hash = hash_curve(*curve, hash);
  }
  const float conditions[4] = {air.temperature_c, air.humidity_percent, air.pressure_kpa, air.speed_of_sound_m_per_s};
  return hash64(std::as_bytes(std::span(conditions)), hash);
}

EmbreeScene rays_of(const TriangleMesh& mesh, const RaySurface* known) {
  if (known) return {mesh.vertices, known->triangles, known->stands_for};
  const RaySurface surface = merge_flat_patches(mesh);
  return {mesh.vertices, surface.triangles, surface.stands_for};
}

}  // namespace

// ISO 9613-1:1993, eq. for the speed of sound in annex A: 343.2 m/s at 20 C.
float Air::speed() const {
  if (speed_of_sound_m_per_s > 0) return speed_of_sound_m_per_s;
  return static_cast<float>(343.2 * std::sqrt((static_cast<double>(temperature_c) + 273.15) / 293.15));
}

Scene::Scene(std::string name, TriangleMesh mesh, std::vector<Material> material_of_slot, Air air, ImportReport report)
    : Scene(std::move(name), std::move(mesh), nullptr, std::move(material_of_slot), air, std::move(report)) {}

Scene::Scene(std::string name, TriangleMesh mesh, const RaySurface& surface, std::vector<Material> material_of_slot, Air air,
             ImportReport report)
    : Scene(std::move(name), std::move(mesh), &surface, std::move(material_of_slot), air, std::move(report)) {}

Scene::Scene(std::string name, TriangleMesh mesh, const RaySurface* surface, std::vector<Material> material_of_slot, Air air,
             ImportReport report)
    : name_(std::move(name)),
      mesh_(std::move(mesh)),
      materials_(std::move(material_of_slot)),
      air_(air),
      speed_of_sound_(air.speed()),
      rays_(rays_of(mesh_, surface)),
      bounds_(bounds_of(mesh_)),
      report_(std::move(report)),
      hash_(hash_scene(mesh_, materials_, air_)) {
  EARSHOT_EXPECT(mesh_.triangle_material.size() == mesh_.triangles.size());
  EARSHOT_EXPECT(mesh_.triangle_object.size() == mesh_.triangles.size());
  EARSHOT_EXPECT(materials_.size() == mesh_.material_names.size());
}

std::size_t Scene::bytes() const {
  std::size_t sum = sizeof(Scene) + bytes_of(name_) + rays_.bytes();
  sum += bytes_of(mesh_.vertices) + bytes_of(mesh_.triangles) + bytes_of(mesh_.triangle_material) + bytes_of(mesh_.triangle_object) +
         bytes_of(mesh_.material_names) + bytes_of(mesh_.object_names);
  sum += bytes_of(materials_) + bytes_of(report_.warnings);
  for (const Material& material : materials_) {
    for (const CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission, &material.damping_db_per_m,
                                          &material.impedance_real, &material.impedance_imaginary})
      sum += bytes_of(curve->hz) + bytes_of(curve->value);
    sum += bytes_of(material.name) + bytes_of(material.labels) + bytes_of(material.source) + bytes_of(material.category);
  }
  return sum;
}

float Scene::triangle_area_m2(std::uint32_t triangle) const {
  const glm::uvec3 t = mesh_.triangles[triangle];
  const glm::dvec3 a = mesh_.vertices[t.x], b = mesh_.vertices[t.y], c = mesh_.vertices[t.z];
  return static_cast<float>(0.5 * glm::length(glm::cross(b - a, c - a)));
}

}  // namespace earshot
