// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/bare_ray_rates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "bench/measure/measured.h"
#include "sim/base/random.h"
#include "sim/base/stopwatch.h"
#include "sim/rays/bare_rays.h"

namespace earshot {
namespace {

constexpr int kBlocks = 5, kBounces = 32;
constexpr float kEarsM = 1.5f;

glm::vec3 on_sphere(std::array<float, 2> random) {
  const auto [u, v] = random;
  const float z = 1.f - 2.f * u, r = std::sqrt(std::max(0.f, 1.f - z * z)), angle = 2.f * std::numbers::pi_v<float> * v;
  return {r * std::cos(angle), r * std::sin(angle), z};
}

/// Directions of a picture at heading 0, in blocks of 4 x 4 pixels as EmbreeCamera takes them; a block that reaches past the picture
/// repeats its last row.
std::vector<glm::vec3> picture(const CameraConfig& camera) {
  const float half = std::tan(camera.horizontal_fov_deg * std::numbers::pi_v<float> / 360.f),
              pixel = 2.f * half / static_cast<float>(camera.width_px);
  std::vector<glm::vec3> directions;
  const auto add = [&](int row, int column) {
    directions.push_back(
        glm::normalize(glm::vec3((static_cast<float>(column) + 0.5f) * pixel - half,
                                 (0.5f * static_cast<float>(camera.height_px) - static_cast<float>(row) - 0.5f) * pixel, -1.f)));
  };
  for (int top = 0; top < camera.height_px; top += 4)
    for (int left = 0; left < camera.width_px; left += 4)  // a multiple of 8
      for (int lane = 0; lane < 16; ++lane) add(std::min(top + lane / 4, camera.height_px - 1), left + lane % 4);
  return directions;
}

/// Median of the rates of blocks of `seconds / kBlocks`; run: traces some rays, returns their number.
template <class Run>
double rate(double seconds, const Run& run) {
  std::vector<double> rates;
  for (int block = 0; block <= kBlocks; ++block) {  // the first warms up
    const Stopwatch watch;
    double rays = 0;
    do rays += run();
    while (watch.wall_s() < seconds / kBlocks);
    if (block > 0) rates.push_back(rays / watch.wall_s());
  }
  return median_of(rates).value;
}

}  // namespace

BareRayRates measure_bare_rays(const Scene& scene, const CameraConfig& camera, std::span<const glm::vec3> poses, double seconds) {
  const BareRays rays(scene.mesh().vertices, scene.mesh().triangles);
  const std::vector<glm::vec3> directions = picture(camera);
  std::size_t next = 0;
  float sum = 0;  // used below, so that no ray can be left out
  BareRayRates rates;
  rates.camera = rate(seconds, [&] {
    const glm::vec3 eye = poses[next % poses.size()] + glm::vec3(0, camera.height_m, 0);
    const float angle = 0.7f * static_cast<float>(next++), c = std::cos(angle), s = std::sin(angle);
    Directions16 turned;
    std::array<float, 16> distances_m;
    for (std::size_t first = 0; first < directions.size(); first += 16) {
      for (std::size_t lane = 0; lane < 16; ++lane) {
        const glm::vec3 d = directions[first + lane];
        turned.x[lane] = c * d.x + s * d.z;
        turned.y[lane] = d.y;
        turned.z[lane] = c * d.z - s * d.x;
      }
      rays.closest16(eye, turned, distances_m);
      sum += distances_m[0];
    }
    return static_cast<double>(directions.size());
  });
  std::uint32_t path = 0;
  rates.diffuse = rate(seconds, [&] {
    const RandomStream random(1, Purpose::bench, path);
    glm::vec3 at = poses[path++ % poses.size()] + glm::vec3(0, kEarsM, 0);
    glm::vec3 direction = on_sphere(random.uniform2(0));
    int traced = 0;
    for (std::uint32_t bounce = 1; bounce <= kBounces; ++bounce) {
      const BareRays::Bounce hit = rays.closest(at, direction);
      ++traced;
      if (!(hit.distance_m < 1e9f)) break;
      glm::vec3 normal = glm::normalize(hit.normal);
      if (glm::dot(normal, direction) > 0) normal = -normal;
      at += hit.distance_m * direction;
      const glm::vec3 lambert = normal + 0.999f * on_sphere(random.uniform2(bounce));
      direction = glm::normalize(lambert);
      sum += hit.distance_m;
    }
    return static_cast<double>(traced);
  });
  if (!(sum > 0)) rates = {};
  return rates;
}

}  // namespace earshot
