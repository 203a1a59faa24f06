// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_report.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/scene/air_sample.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "sim/scene/probe_rays.h"

namespace earshot {
namespace {

constexpr std::uint32_t rays = 16384, walks = 4096, bounces = 32, warm_up_bounces = 4;

std::uint64_t count_open_edges(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> first = weld_map(mesh.vertices, 0);
  std::vector<std::uint64_t> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const glm::uvec3 triangle : mesh.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      const std::uint64_t a = first[triangle[corner]], b = first[triangle[(corner + 1) % 3]];
      edges.push_back(std::min(a, b) << 32 | std::max(a, b));
    }
  }
  std::sort(edges.begin(), edges.end());
  std::uint64_t open = 0;
  for (std::size_t begin = 0; begin < edges.size();) {
    std::size_t end = begin;
    while (end < edges.size() && edges[end] == edges[begin]) ++end;
    open += end - begin == 1;
    begin = end;
  }
  return open;
}

double measure_ray_efficiency(const Scene& scene, std::span<const glm::vec3> air, std::uint64_t seed) {
  if (air.empty()) return 0;
  std::uint32_t hits = 0;
  for (std::uint32_t ray = 0; ray < rays; ++ray) {
    const glm::vec3 direction = probe::uniform_direction(probe::stream(seed, probe::Use::first_ray, ray).uniform2(0));
    hits += scene.rays().intersect(air[ray * air.size() / rays], direction).valid();
  }
  return static_cast<double>(hits) / rays;
}

/// Free paths and absorption that diffusely reflected sound meets.
struct DiffuseWalk {
  double mean_free_path_m = 0;
  double escaped_fraction = 0;                              ///< of the segments
  std::array<double, report_bands_hz.size()> absorption{};  ///< mean over hits
};

DiffuseWalk walk_diffusely(const Scene& scene, std::span<const glm::vec3> air, std::uint64_t seed) {
  std::vector<std::array<double, report_bands_hz.size()>> absorption(scene.materials().size());
  for (std::size_t slot = 0; slot < absorption.size(); ++slot) {
    for (std::size_t band = 0; band < report_bands_hz.size(); ++band) {
      constexpr float half_octave = std::numbers::sqrt2_v<float>;
      absorption[slot][band] =
          scene.materials()[slot].absorption.band_mean(report_bands_hz[band] / half_octave, report_bands_hz[band] * half_octave);
    }
  }
  DiffuseWalk result;
  std::uint64_t hits = 0, escapes = 0;
  double path_m = 0;
  for (std::uint32_t i = 0; i < walks; ++i) {
    const RandomStream random = probe::stream(seed, probe::Use::walk, i);
    glm::vec3 from = air[i * air.size() / walks];
    glm::vec3 direction = probe::uniform_direction(random.uniform2(0));
    for (std::uint32_t bounce = 0; bounce < warm_up_bounces + bounces; ++bounce) {
      const Hit hit = scene.rays().intersect(from, direction);
      if (!hit.valid()) {
        ++escapes;
        break;
      }
      if (bounce >= warm_up_bounces) {  // the first paths start in the air, not on a surface
        ++hits;
        path_m += hit.distance_m;
        const auto& alpha = absorption[scene.mesh().triangle_material[hit.triangle]];
        for (std::size_t band = 0; band < alpha.size(); ++band) result.absorption[band] += alpha[band];
      }
      from = offset_from_surface(hit.position, hit.normal);
      direction = probe::cosine_direction(hit.normal, random.uniform2(bounce + 1));
    }
  }
  if (hits == 0) return result;
  result.mean_free_path_m = path_m / static_cast<double>(hits);
  result.escaped_fraction = static_cast<double>(escapes) / static_cast<double>(hits + escapes);
  for (double& alpha : result.absorption) alpha /= static_cast<double>(hits);
  return result;
}

/// Eyring (Kuttruff, Room Acoustics, 5th ed., eq. 5.24 with 4V/S = mean free path): 60 dB of exp(-c t (m - ln(1 - a) / path)).
double eyring_s(double mean_free_path_m, double absorption, double air_per_m, double speed) {
  const double decay_per_m = air_per_m - std::log1p(-absorption) / mean_free_path_m;
  return 6.0 * std::numbers::ln10 / (speed * decay_per_m);
}

}  // namespace

SceneReport report_scene(const Scene& scene, std::uint64_t seed, std::span<const double> air_exponent_per_m) {
  EARSHOT_EXPECT(air_exponent_per_m.empty() || air_exponent_per_m.size() == report_bands_hz.size());
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  SceneReport report;
  report.triangles = scene.mesh().triangles.size();
  report.removed = scene.import_report();
  report.leaked_ray_fraction = 1;
  report.area_m2 = nan;
  report.rt60_estimate_s.assign(report_bands_hz.size(), nan);
  if (report.triangles == 0) return report;
  report.open_edges = count_open_edges(scene.mesh());

  const AirSample air = sample_air(scene, seed);
  report.ray_efficiency = measure_ray_efficiency(scene, air.points, seed);
  report.leaked_ray_fraction = 1 - report.ray_efficiency;
  const glm::dvec3 size = glm::dvec3(scene.bounds().upper) - glm::dvec3(scene.bounds().lower);
  report.volume_m3 = size.x * size.y * size.z;
  if (report.leaked_ray_fraction > SceneReport::open_fraction) return report;

  report.volume_m3 *= air.fraction_of_bounds;
  const DiffuseWalk walk = walk_diffusely(scene, air.points, seed);
  if (!(walk.mean_free_path_m > 0)) return report;
  report.area_m2 = 4 * report.volume_m3 / walk.mean_free_path_m;
  for (std::size_t band = 0; band < report_bands_hz.size(); ++band) {
    // Energy that escapes through a hole is lost like absorbed energy.
    const double absorption = 1 - (1 - walk.absorption[band]) * (1 - walk.escaped_fraction);
    const double air_per_m = air_exponent_per_m.empty() ? 0 : air_exponent_per_m[band];
    report.rt60_estimate_s[band] = eyring_s(walk.mean_free_path_m, absorption, air_per_m, scene.speed_of_sound_m_per_s());
  }
  return report;
}

}  // namespace earshot
