#include "sim/scene/scene_report.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <numeric>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/scene/mesh_repair.h"

namespace earshot {
namespace {

constexpr std::uint32_t cells_per_axis = 16, cells = cells_per_axis * cells_per_axis * cells_per_axis, passes = 4;
constexpr std::uint32_t rays = 16384, walks = 4096, bounces = 32, warm_up_bounces = 4;

// What the numbers of one random stream are for (its third word).
enum Use : std::uint32_t { place = 0, first_ray = 1, walk = 2, partner = 3 };

RandomStream stream(std::uint64_t seed, Use use, std::uint32_t item) {
  return RandomStream(seed, Purpose::ray_efficiency, item, static_cast<std::uint32_t>(use));
}

glm::vec3 uniform_direction(std::array<float, 2> u) {
  const float y = 1 - 2 * u[0], radius = std::sqrt(std::max(0.f, 1 - y * y)), angle = 2 * std::numbers::pi_v<float> * u[1];
  return {radius * std::cos(angle), y, radius * std::sin(angle)};
}

/// Lambert: a unit vector around the normal plus the normal itself.
glm::vec3 cosine_direction(glm::vec3 normal, std::array<float, 2> u) {
  const glm::vec3 sum = normal + uniform_direction(u);
  const float length = glm::length(sum);
  return length > 1e-6f ? sum / length : normal;
}

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

/// Sets that grow together: points that can see each other, directly or over others.
class Regions {
 public:
  explicit Regions(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Stratified points of the bounds that have a floor below them.
std::vector<glm::vec3> points_over_floor(const Scene& scene, std::uint64_t seed) {
  const Bounds& bounds = scene.bounds();
  glm::vec3 size = bounds.upper - bounds.lower;
  size.y = std::max(size.y, 0.01f * std::max(size.x, size.z));  // a flat scene has its air above it
  std::vector<glm::vec3> points;
  for (std::uint32_t i = 0; i < passes * cells; ++i) {
    const std::uint32_t cell = i % cells;
    const std::array<float, 4> u = stream(seed, place, i).uniform4(0);
    const glm::vec3 share((static_cast<float>(cell % cells_per_axis) + u[0]) / cells_per_axis,
                          (static_cast<float>(cell / cells_per_axis % cells_per_axis) + u[1]) / cells_per_axis,
                          (static_cast<float>(cell / cells_per_axis / cells_per_axis) + u[2]) / cells_per_axis);
    const glm::vec3 point = bounds.lower + share * size;
    if (scene.rays().intersect(point, {0, -1, 0}).valid()) points.push_back(point);
  }
  return points;
}

double measure_ray_efficiency(const Scene& scene, std::span<const glm::vec3> points, std::span<const std::uint32_t> members,
                              std::uint64_t seed) {
  if (members.empty()) return 0;
  std::uint32_t hits = 0;
  for (std::uint32_t ray = 0; ray < rays; ++ray) {
    const glm::vec3 direction = uniform_direction(stream(seed, first_ray, ray).uniform2(0));
    hits += scene.rays().intersect(points[members[ray * members.size() / rays]], direction).valid();
  }
  return static_cast<double>(hits) / rays;
}

/// Free paths and absorption that diffusely reflected sound meets.
struct DiffuseWalk {
  double mean_free_path_m = 0;
  double escaped_share = 0;                                 ///< of the segments
  std::array<double, report_bands_hz.size()> absorption{};  ///< mean over hits
};

/// Points of the largest region of air.  Walks from each point look, at every bounce, for another point in sight.
std::vector<std::uint32_t> largest_region(const Scene& scene, std::span<const glm::vec3> points, std::uint64_t seed) {
  if (points.empty()) return {};
  const auto count = static_cast<std::uint32_t>(points.size());
  Regions regions(count);
  constexpr std::uint32_t region_bounces = 6;
  for (std::uint32_t i = 0; i < count; ++i) {
    const RandomStream random = stream(seed, partner, i);
    glm::vec3 from = points[i], direction = uniform_direction(random.uniform2(0));
    for (std::uint32_t bounce = 1; bounce <= region_bounces; ++bounce) {
      const std::uint32_t other = random.below(count, 2 * bounce);
      if (regions.find(i) != regions.find(other) && !scene.rays().occluded(from, points[other])) regions.join(i, other);
      const Hit hit = scene.rays().intersect(from, direction);
      if (!hit.valid()) break;
      from = offset_from_surface(hit.position, hit.normal);
      direction = cosine_direction(hit.normal, random.uniform2(2 * bounce + 1));
    }
  }
  std::vector<std::uint32_t> size(count, 0);
  for (std::uint32_t i = 0; i < count; ++i) ++size[regions.find(i)];
  const auto largest = static_cast<std::uint32_t>(std::max_element(size.begin(), size.end()) - size.begin());
  std::vector<std::uint32_t> members;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (regions.find(i) == largest) members.push_back(i);
  }
  return members;
}

DiffuseWalk walk_diffusely(const Scene& scene, std::span<const glm::vec3> points, std::span<const std::uint32_t> members,
                           std::uint64_t seed) {
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
    const RandomStream random = stream(seed, walk, i);
    glm::vec3 from = points[members[i * members.size() / walks]];
    glm::vec3 direction = uniform_direction(random.uniform2(0));
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
      direction = cosine_direction(hit.normal, random.uniform2(bounce + 1));
    }
  }
  if (hits == 0) return result;
  result.mean_free_path_m = path_m / static_cast<double>(hits);
  result.escaped_share = static_cast<double>(escapes) / static_cast<double>(hits + escapes);
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
  report.leaked_ray_share = 1;
  report.area_m2 = nan;
  report.rt60_estimate_s.assign(report_bands_hz.size(), nan);
  if (report.triangles == 0) return report;
  report.open_edges = count_open_edges(scene.mesh());

  const std::vector<glm::vec3> points = points_over_floor(scene, seed);
  const std::vector<std::uint32_t> members = largest_region(scene, points, seed);  // not the inside of walls
  report.ray_efficiency = measure_ray_efficiency(scene, points, members, seed);
  report.leaked_ray_share = 1 - report.ray_efficiency;
  const glm::dvec3 size = glm::dvec3(scene.bounds().upper) - glm::dvec3(scene.bounds().lower);
  report.volume_m3 = size.x * size.y * size.z;
  if (report.leaked_ray_share > SceneReport::open_share) return report;

  report.volume_m3 *= static_cast<double>(members.size()) / (passes * cells);
  const DiffuseWalk walk = walk_diffusely(scene, points, members, seed);
  if (!(walk.mean_free_path_m > 0)) return report;
  report.area_m2 = 4 * report.volume_m3 / walk.mean_free_path_m;
  for (std::size_t band = 0; band < report_bands_hz.size(); ++band) {
    // What escapes through a hole is lost like what is absorbed.
    const double absorption = 1 - (1 - walk.absorption[band]) * (1 - walk.escaped_share);
    const double air = air_exponent_per_m.empty() ? 0 : air_exponent_per_m[band];
    report.rt60_estimate_s[band] = eyring_s(walk.mean_free_path_m, absorption, air, scene.speed_of_sound_m_per_s());
  }
  return report;
}

}  // namespace earshot
