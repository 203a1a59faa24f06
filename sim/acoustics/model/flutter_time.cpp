// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/flutter_time.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/acoustics/model/air_points.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxPlanes = 64;
constexpr float kParallelSine = 1e-3f;
constexpr double kMinReflected = 0.6;
constexpr std::size_t kSteps = 96;

/// The largest triangle of each of the first planes.
std::vector<std::uint32_t> largest_triangles(const AcousticSurfaces& surfaces) {
  const std::size_t planes = std::min(surfaces.planes().size(), kMaxPlanes);
  std::vector<std::uint32_t> largest(planes, 0);
  std::vector<float> area(planes, -1.f);
  const TriangleMesh& mesh = surfaces.scene().mesh();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::uint32_t plane = surfaces.plane_of_triangle()[t];
    if (plane >= planes) continue;
    const glm::uvec3 corner = mesh.triangles[t];
    const glm::vec3 a = mesh.vertices[corner.x];
    const float twice_m2 = glm::length(glm::cross(mesh.vertices[corner.y] - a, mesh.vertices[corner.z] - a));
    if (twice_m2 > area[plane]) area[plane] = twice_m2, largest[plane] = t;
  }
  return largest;
}

/// Two planes as they face each other at one place.
struct Pair {
  double gap_m;
  std::array<std::uint32_t, 2> material;
  glm::vec3 middle;
};

double reflected(const AcousticSurfaces& surfaces, const Pair& pair, std::size_t band) {
  double product = 1;
  for (const std::uint32_t slot : pair.material)
    product *= double{surfaces.reflectance(slot)[band]} * (1.0 - surfaces.scattering(slot)[band]);
  return std::sqrt(product);
}

bool is_mirror(const AcousticSurfaces& surfaces, const Pair& pair) {
  for (std::size_t band = 0; band < static_cast<std::size_t>(surfaces.num_bands()); ++band)
    if (reflected(surfaces, pair, band) > kMinReflected) return true;
  return false;
}

/// Do the planes face each other over more than a doorway?  Through two doors in a row one wall of a house faces another: only listeners in
/// line with the doors hear that row.
bool is_wide(const AcousticSurfaces& surfaces, const Pair& pair, glm::vec3 normal) {
  constexpr float half_width_m = 0.45f;
  const EmbreeScene& rays = surfaces.scene().rays();
  const glm::vec3 along = glm::normalize(glm::cross(normal, std::abs(normal.y) < 0.9f ? glm::vec3(0, 1, 0) : glm::vec3(1, 0, 0)));
  for (const glm::vec3 sideways : {along, glm::cross(normal, along)}) {
    for (const float offset_m : {-half_width_m, half_width_m}) {
      const glm::vec3 point = pair.middle + offset_m * sideways;
      if (rays.occluded(pair.middle, point)) return false;
      const float free_m = rays.intersect(point, normal).distance_m + rays.intersect(point, -normal).distance_m;
      if (!(free_m > 0.95 * pair.gap_m)) return false;
    }
  }
  return true;
}

/// Path after which the flutter has fallen to `fall_db` below all sound; 0 if it never stands above that.
double fall_m(double gap_m, double flutter_per_m, double diffuse_per_m, double volume_m3, double fall_db, double horizon_m) {
  // Of path r, times r for steps of equal ratio.
  const auto flutter = [&](double r) {
    return 2.0 / gap_m * std::exp(-flutter_per_m * r) / (16.0 * std::numbers::pi * std::numbers::pi * r);
  };
  const double step = std::log(std::max(horizon_m, 2 * gap_m) / gap_m) / (kSteps - 1);
  const auto path_m = [&](std::size_t i) { return gap_m * std::exp(step * static_cast<double>(i)); };
  // With the source at one mirror and the listener at the other nothing comes before the way between them, r = gap.
  const double diffuse = volume_m3 > 0 ? std::exp(-diffuse_per_m * gap_m) / (4.0 * std::numbers::pi * volume_m3 * diffuse_per_m) : 0.0;
  // Energy after the horizon: the row decays as 1 / r^2 or by its reflections, whichever is faster.
  std::array<double, kSteps> left;
  const double last_m = path_m(kSteps - 1);
  left[kSteps - 1] = flutter(last_m) * std::min(1.0, 1.0 / std::max(flutter_per_m * last_m, 1e-12));
  for (std::size_t i = kSteps - 1; i-- > 0;) left[i] = left[i + 1] + 0.5 * step * (flutter(path_m(i)) + flutter(path_m(i + 1)));
  const double total = left[0] + diffuse, least = total * std::pow(10.0, -0.1 * fall_db);
  for (std::size_t i = 0; i < kSteps; ++i)
    if (left[i] <= least) return i == 0 ? 0 : path_m(i);
  return last_m * fall_db / std::max(10.0 * std::log10(total / left[kSteps - 1]), 1e-3);
}

}  // namespace

std::vector<double> flutter_times(const AcousticSurfaces& surfaces, std::span<const double> air_energy_per_m, double fall_db,
                                  double horizon_s) {
  const auto num_bands = static_cast<std::size_t>(surfaces.num_bands());
  std::vector<double> times_s(num_bands, 0.0);
  const EmbreeScene& rays = surfaces.scene().rays();
  const TriangleMesh& mesh = surfaces.scene().mesh();
  std::vector<Pair> pairs;
  for (const std::uint32_t triangle : largest_triangles(surfaces)) {
    const glm::uvec3 corners = mesh.triangles[triangle];
    const std::array<glm::vec3, 3> corner{mesh.vertices[corners.x], mesh.vertices[corners.y], mesh.vertices[corners.z]};
    const glm::vec3 across = glm::cross(corner[1] - corner[0], corner[2] - corner[0]);
    if (!(glm::length(across) > 0.f)) continue;
    const glm::vec3 normal = glm::normalize(across), centre = (corner[0] + corner[1] + corner[2]) / 3.f;
    for (const float side : {-1.f, 1.f}) {
      for (std::size_t place = 0; place < 4; ++place) {
        const glm::vec3 point = place == 0 ? centre : 0.5f * (centre + corner[place - 1]);
        const glm::vec3 origin = offset_from_surface(point, side * normal);
        const Hit hit = rays.intersect(origin, side * normal);
        if (!hit.valid() || glm::length(glm::cross(hit.normal, normal)) > kParallelSine) continue;
        const Pair pair{hit.distance_m,
                        {mesh.triangle_material[triangle], mesh.triangle_material[hit.triangle]},
                        origin + 0.5f * hit.distance_m * side * normal};
        // The same two materials as far apart are the same pair, or one like it.
        const bool known = std::any_of(pairs.begin(), pairs.end(), [&](const Pair& other) {
          return std::minmax(other.material[0], other.material[1]) == std::minmax(pair.material[0], pair.material[1]) &&
                 std::abs(other.gap_m - pair.gap_m) < 0.02 * pair.gap_m;
        });
        if (!known && is_mirror(surfaces, pair) && is_room(surfaces, pair.middle) && is_wide(surfaces, pair, normal)) pairs.push_back(pair);
      }
    }
  }
  const double speed = surfaces.speed_of_sound_m_per_s();
  for (const Pair& pair : pairs) {
    const RoomGuess room = guess_room(surfaces, pair.middle, air_energy_per_m);
    for (std::size_t band = 0; band < num_bands; ++band) {
      const double mirror = reflected(surfaces, pair, band);
      if (!(mirror > kMinReflected)) continue;
      const double flutter_per_m = -std::log(mirror) / pair.gap_m + air_energy_per_m[band];
      const double volume_m3 = room.closed ? room.volume_m3 : 0.0;
      const double way_m = fall_m(pair.gap_m, flutter_per_m, std::max(room.loss_per_m[band], 1e-9), volume_m3, fall_db, horizon_s * speed);
      times_s[band] = std::max(times_s[band], way_m / speed);
    }
  }
  return times_s;
}

}  // namespace earshot
