// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/mirror_decay.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/acoustics/core/sampling.h"

namespace earshot {
namespace {

constexpr double kDecayDb = 35;        // where T30 ends
constexpr double kMinRatio = 0.25;     // of the energies: a decibel
constexpr double kMinReflected = 0.6;  // of energy, mean of both surfaces
constexpr int kNumRays = 64;

double box_volume_m3(const Bounds& bounds) {
  const glm::dvec3 size(bounds.upper - bounds.lower);
  return size.x * size.y * size.z;
}

}  // namespace

DiffuseDecay::DiffuseDecay(const AcousticScene& scene, glm::vec3 source)
    : scene_(scene), loss_per_m_(static_cast<std::size_t>(scene.num_bands())) {
  const SphereSequence directions(0, 0);
  int escaped = 0;
  for (std::uint32_t ray = 0; ray < kNumRays; ++ray)
    escaped += scene.scene().rays().intersect(source, directions.direction(ray)).valid() ? 0 : 1;
  const double met = 1.0 - static_cast<double>(escaped) / kNumRays;
  for (std::size_t band = 0; band < loss_per_m_.size(); ++band) {
    const double lost = 1.0 - met * (1.0 - scene.surfaces().mean_absorption()[band]);
    loss_per_m_[band] = -std::log1p(-std::min(lost, 1.0 - 1e-9)) / std::max(scene.plan().mean_free_path_m, 1e-3);
  }
}

bool DiffuseDecay::exceeded_by(std::uint32_t first, std::uint32_t second, double gap_m) const {
  const double volume_m3 = box_volume_m3(scene_.scene().bounds());
  for (int band = 0; band < scene_.num_bands(); ++band) {
    const double reflected = std::sqrt(specular_fraction(scene_, first, band, 1.0) * specular_fraction(scene_, second, band, 1.0));
    if (!(reflected > kMinReflected)) continue;
    const double diffuse_per_m = loss_per_m_[static_cast<std::size_t>(band)], chain_per_m = -std::log(reflected) / gap_m;
    const double furthest_m =
        std::min(diffuse_per_m > 0 ? 0.1 * kDecayDb * std::numbers::ln10 / diffuse_per_m : 1e9, double{scene_.max_path_m()});
    const double ratio = 2.0 * volume_m3 / (4.0 * std::numbers::pi * gap_m * furthest_m * furthest_m) *
                         std::exp(std::min((diffuse_per_m - chain_per_m) * furthest_m, 100.0));
    if (ratio > kMinRatio) return true;
  }
  return false;
}

}  // namespace earshot
