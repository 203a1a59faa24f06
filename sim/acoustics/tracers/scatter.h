// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/band_sum.h"
#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/model/lobe_shares.h"
#include "sim/acoustics/model/reflection_model.h"
#include "sim/acoustics/model/specular_lobe.h"
#include "sim/acoustics/model/wall_crossing.h"
#include "sim/rays/embree_scene.h"

/// How a subpath of the bidirectional tracer goes on from a surface: the same for both ends.
namespace earshot {

/// Energy of a subpath per band.  W: bands rounded up to whole vectors; lanes past the last band stay zero.
template <int W>
struct alignas(32) SubpathEnergy {
  float arriving[W];   ///< before the surface
  float reflected[W];  ///< after it: arriving times what the surface keeps, all ways of leaving together
  /// Probability density of the path so far in each band over its mean over bands (hero wavelengths, Wilkie et al. 2014; listener_ray.h).
  float weight[W];
};

template <int W>
void meet_surface(const ReflectionModel& model, std::uint32_t material, SubpathEnergy<W>& energy) {
  const float* kept = model.kept(material);
  for (int b = 0; b < W; ++b) energy.reflected[b] = energy.arriving[b] * kept[b];
}

/// Fraction that leaves from `in` toward `out`, per steradian and band, of what the surface keeps.
template <int W>
void rough_value(const ReflectionModel& model, std::uint32_t material, glm::vec3 normal, glm::vec3 in, glm::vec3 out, float (&value)[W]) {
  constexpr float per_pi = std::numbers::inv_pi_v<float>;
  const float* diffuse = model.diffuse(material);
  for (int b = 0; b < W; ++b) value[b] = diffuse[b] * per_pi;
  for (const ReflectionModel::Lobe& lobe : model.lobes(material)) {
    const float lobe_value = lobe.lobe->value(normal, in, out);
    const float* fraction = model.fraction(lobe);
    for (int b = 0; b < W; ++b) value[b] += fraction[b] * lobe_value;
  }
}

enum class Leaving {
  rough,    ///< in a direction drawn from a density: a vertex that can be connected
  mirror,   ///< as from a mirror
  through,  ///< straight through the wall
};

/// How a subpath leaves a surface.
struct Departure {
  Leaving way;
  float extra_path_m;  ///< length that a wall adds to the path
};

/// Absorption inside a wall, beside tau, which the fractions of a material include.
template <int W>
void absorb_inside(const AcousticScene& scene, std::uint32_t material, const WallCrossing& crossing, SubpathEnergy<W>& energy) {
  alignas(32) std::array<float, W> passed;
  passed.fill(1.f);
  transmit(scene.surfaces(), crossing, std::span(passed).first(static_cast<std::size_t>(scene.num_bands())));
  const auto tau = scene.transmission(material);
  for (std::size_t b = 0; b < tau.size(); ++b) energy.arriving[b] *= tau[b] > 0.f ? passed[b] / tau[b] : 0.f;
}

/// Draws how and where the subpath leaves.  On entry origin and direction are those of the segment that ended at `hit`; on return those of
/// the next one; arriving and weight are those behind the event.  u: uniform in [0, 1).
template <int W>
Departure leave_surface(const AcousticScene& scene, const Hit& hit, const std::array<float, 4>& u, SubpathEnergy<W>& energy,
                        glm::vec3& origin, glm::vec3& direction) {
  const ReflectionModel& model = scene.reflection_model();
  const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
  const auto num_bands = static_cast<float>(scene.num_bands());
  const auto probability_of = [&](const float* fractions) {
    alignas(32) float weighted[W];
    for (int b = 0; b < W; ++b) weighted[b] = energy.weight[b] * fractions[b];
    return std::min(sum_over_bands<W>(weighted) / num_bands, 1.f);
  };
  const auto take = [&](const float* fractions, float probability) {
    // Rounding may leave no probability for what is all but never picked.
    const float scale = probability > 0.f ? 1.f / probability : 0.f;
    for (int b = 0; b < W; ++b) {
      const float factor = fractions[b] * scale;
      energy.arriving[b] = energy.reflected[b] * factor;
      energy.weight[b] *= factor;
    }
  };
  const auto leave_as_from_mirror = [&](float probability) -> Departure {
    take(model.mirror(material), probability);
    if (scene.surfaces().reacts_locally(material))
      scene.surfaces().scale_by_angle(material, double{std::abs(glm::dot(direction, hit.normal))},
                                      std::span(energy.arriving).first(static_cast<std::size_t>(scene.num_bands())));
    direction = mirror_direction(direction, hit.normal);
    return {Leaving::mirror, 0.f};
  };
  float through_probability = 0.f;
  if (model.transmits(material)) {
    const float* transmitted = model.transmitted(material);
    through_probability = probability_of(transmitted);
    if (u[2] < through_probability) {
      take(transmitted, through_probability);
      const WallCrossing crossing = cross_wall(scene.surfaces(), direction, hit);
      if (crossing.inside_m > 0.f) absorb_inside(scene, material, crossing, energy);
      origin = crossing.exit;
      return {Leaving::through, crossing.inside_m + extra_path_m(scene.surfaces(), crossing)};
    }
  }
  const float diffuse_probability = probability_of(model.diffuse(material));
  const bool diffuse = u[2] < through_probability + diffuse_probability;
  const glm::vec3 in = -direction;
  origin = offset_from_surface(hit.position, hit.normal);
  const std::span<const ReflectionModel::Lobe> lobes = model.lobes(material);
  if (lobes.empty()) {
    if (diffuse) {
      take(model.diffuse(material), diffuse_probability);
      direction = lambert_direction(hit.normal, u[0], u[1]);
      return {Leaving::rough, 0.f};
    }
    return leave_as_from_mirror(1.f - through_probability - diffuse_probability);
  }
  // Which lobe?  Without a mirror the last one has all that is left.
  std::array<float, kLobeLadder> lobe_probability;
  const ReflectionModel::Lobe* chosen = diffuse ? nullptr : &lobes.back();
  float left = std::max(1.f - through_probability - diffuse_probability, 0.f), behind = through_probability + diffuse_probability;
  bool is_chosen = diffuse;
  for (std::size_t i = 0; i < lobes.size(); ++i) {
    const bool is_last = i + 1 == lobes.size() && !model.mirrors(material);
    lobe_probability[i] = is_last ? left : std::min(probability_of(model.fraction(lobes[i])), left);
    left -= lobe_probability[i];
    behind += lobe_probability[i];
    if (!is_chosen && (is_last || u[2] < behind)) chosen = &lobes[i], is_chosen = true;
  }
  if (!is_chosen) return leave_as_from_mirror(left);
  // One direction for the whole mixture, weighed by the density of the whole mixture (one-sample balance heuristic).
  direction = diffuse ? lambert_direction(hit.normal, u[0], u[1]) : chosen->lobe->sample(hit.normal, in, u[0], u[1], u[3]);
  const float cosine = std::max(glm::dot(hit.normal, direction), 0.f);
  const float lambert_pdf = cosine * std::numbers::inv_pi_v<float>;
  const float* diffuse_fraction = model.diffuse(material);
  alignas(32) float value[W], pdf[W];
  for (int b = 0; b < W; ++b) value[b] = pdf[b] = diffuse_fraction[b] * lambert_pdf;
  float density = diffuse_probability * lambert_pdf;
  for (std::size_t i = 0; i < lobes.size(); ++i) {
    const float lobe_pdf = lobes[i].lobe->pdf(hit.normal, in, direction), lobe_value = lobes[i].lobe->value(hit.normal, in, direction);
    const float* fraction = model.fraction(lobes[i]);
    density += lobe_probability[i] * lobe_pdf;
    for (int b = 0; b < W; ++b) {
      value[b] += fraction[b] * lobe_value * cosine;
      pdf[b] += fraction[b] * lobe_pdf;
    }
  }
  const float scale = density > 0.f ? 1.f / density : 0.f;
  for (int b = 0; b < W; ++b) {
    energy.arriving[b] = energy.reflected[b] * value[b] * scale;
    energy.weight[b] *= pdf[b] * scale;
  }
  return {Leaving::rough, 0.f};
}

}  // namespace earshot
