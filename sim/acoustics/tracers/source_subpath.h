// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/mis_weight.h"
#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/acoustics/tracers/scatter.h"
#include "sim/acoustics/tracers/source_volume.h"
#include "sim/base/random.h"

/// Subpaths from the source, traced once per batch and kept for the connections of all listener vertices.  Internal to the tracer.
namespace earshot {

/// State shared by all subpaths of one bidirectional trace.
struct BidirectionalScene {
  const AcousticScene& scene;
  const EarlyCandidates& candidates;
  const ReflectionModel& model;
  const Emission* emission;  // null: omnidirectional
  glm::vec3 source, listener;
  float source_radius_m;  // over whose volume the source is spread; 0: a point
  float volume_radius_m;  // of the sphere that catches what no strategy can connect
  mis::Strategies strategies;
  int max_bounces, carried_order, sh_order, num_coefficients;
  float max_path_m, seconds_per_m, stage_m, least_distance2_m2;
  std::uint64_t seed;
};

template <int W>
struct SourceVertex {
  alignas(32) float reflected[W];  // energy that the surface keeps of what arrives, per unit of emitted energy
  glm::vec3 position{0}, normal{0}, toward_previous{0};
  std::uint32_t material = 0;
  float path_m = 0;
  mis::SourceEnd end;
  bool exists = false;
};

inline glm::vec3 point_of_source(const BidirectionalScene& shared, float u, float v, float w) {
  return shared.source_radius_m > 0.f ? point_in_sphere(shared.source, shared.source_radius_m, u, v, w) : shared.source;
}

/// Energy gain per band toward `direction`: multiplies the lanes of the bands.
template <int W>
void apply_emission(const BidirectionalScene& shared, glm::vec3 direction, float (&energy)[W]) {
  if (!shared.emission) return;
  std::array<float, W> gain{};
  shared.emission->energy(direction, std::span(gain).first(static_cast<std::size_t>(shared.scene.num_bands())));
  for (int b = 0; b < W; ++b) energy[b] *= gain[b];
}

/// Fills vertices[i - 1] with the i-th event of one path from the source, until the path leaves the scene, ends in time, or has no energy.
template <int W>
void trace_source_subpath(const BidirectionalScene& shared, glm::vec3 direction, const RandomStream& random,
                          std::span<SourceVertex<W>> vertices, TraceStats& stats) {
  const AcousticScene& scene = shared.scene;
  SubpathEnergy<W> energy;
  for (int b = 0; b < W; ++b) energy.arriving[b] = energy.weight[b] = b < scene.num_bands() ? 1.f : 0.f;
  apply_emission(shared, direction, energy.arriving);
  glm::vec3 origin = shared.source;
  if (shared.source_radius_m > 0.f) {
    const auto u = random.uniform4(0);
    origin = point_of_source(shared, u[0], u[1], u[2]);
  }
  mis::SourceChain chain(shared.strategies);
  float path_m = 0.f;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const Hit hit = scene.scene().rays().intersect(origin, direction);
    ++(hit.valid() ? stats.ray_hits : stats.ray_escapes);
    path_m += hit.distance_m;
    if (!hit.valid() || path_m >= shared.max_path_m) return;
    SourceVertex<W>& vertex = vertices[i];
    vertex.material = scene.scene().mesh().triangle_material[hit.triangle];
    meet_surface(shared.model, vertex.material, energy);
    const float total = sum_over_bands<W>(energy.reflected);
    if (!std::isfinite(total)) ++stats.nonfinite_dropped;
    if (!(total > 0.f) || !std::isfinite(total)) return;
    for (int b = 0; b < W; ++b) vertex.reflected[b] = energy.reflected[b];
    vertex.position = offset_from_surface(hit.position, hit.normal);
    vertex.normal = hit.normal;
    vertex.toward_previous = -direction;
    vertex.path_m = path_m;
    vertex.end = chain.arrive(-glm::dot(hit.normal, direction), hit.distance_m);
    vertex.exists = true;

    const auto draw = static_cast<std::uint32_t>(i) + 1;
    const Departure departure = leave_surface(scene, hit, random.uniform4(draw), energy, origin, direction);
    path_m += departure.extra_path_m;
    if (departure.way == Leaving::rough) {
      const glm::vec3 toward = vertex.toward_previous;
      chain.leave(vertex.end, shared.model.mean_pdf(vertex.material, hit.normal, toward, direction),
                  shared.model.mean_pdf(vertex.material, hit.normal, direction, toward), glm::dot(hit.normal, direction));
    } else {
      chain.segment().pass(hit.distance_m + departure.extra_path_m);
    }
  }
}

}  // namespace earshot
