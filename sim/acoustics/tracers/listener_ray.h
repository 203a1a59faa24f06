// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/band_sum.h"
#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/model/reflection_model.h"
#include "sim/acoustics/model/wall_crossing.h"
#include "sim/acoustics/tracers/listener_paths.h"
#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/acoustics/tracers/source_volume.h"
#include "sim/acoustics/tracers/wall_roulette.h"
#include "sim/base/random.h"

/// One listener ray of the path tracer, from vertex to vertex.  Internal to path_tracer.cpp; its equations are those of
/// docs/explanation/estimators.md, sections 1 to 5.
namespace earshot::listener_ray {

inline constexpr float kPi = std::numbers::pi_v<float>;
inline constexpr int kMaxChain = 4;
inline constexpr float kBelowOne = 0x1.fffffep-1f;  // the largest float below 1

/// State shared by all rays of one trace.
struct Trace {
  const AcousticScene& scene;
  const EarlyCandidates& candidates;
  const Emission* emission;      // null: omnidirectional
  const ReflectionModel* walls;  // null: no surface lets anything through
  glm::vec3 source, listener;
  SphereSequence directions;
  std::uint32_t num_rays;
  int max_bounces, carried_order, sh_order, num_coefficients;
  float weight_per_ray;  // 1 / num_rays
  float max_path_m, seconds_per_m;
  float stage_m;             // population control runs each time they have gone this far
  float least_distance2_m2;  // of the geometry term
  float source_radius_m;     // zero: no source volume
  float source_spread_m;     // next-event estimation aims at points in a sphere of this radius; zero: at the centre
  bool diffuse_last_segment;
};

/// One listener ray under way.  W: bands rounded up to whole vectors; lanes past the last band stay zero.
template <int W>
struct alignas(32) RayState {
  float throughput[W], reflected[W], arriving[W];
  /// Probability density of the path so far in each band, divided by its mean over bands.  Lobes are picked with the mean probability, so
  /// this is the balance heuristic over bands (hero wavelengths, Wilkie et al. 2014): it never exceeds the number of bands, where
  /// independent picks by the plain mean would let the weight of a band grow exponentially with the bounces.
  float weight[W];
  std::array<float, kMaxCoefficients> sh;
  std::array<std::uint32_t, kMaxChain> chain;           // first planes of a purely specular path, listener first
  int chain_length = 0;                                 // of the whole path, also beyond kMaxChain
  std::uint32_t first = 0;                              // of the rays that left the listener, the one that it comes from
  std::uint32_t vertex = ListenerPaths::Vertex::kNone;  // the last one that was recorded
  LongChains::Chain long_chain;                         // the same for longer ones
  bool all_specular = true, after_mirror = false;       // after_mirror: or after a wall that was passed straight
  bool only_walls = false;                              // all so far were walls passed straight
  bool alive = true, at_vertex = false;                 // at_vertex: `reflected` and `hit` wait for a lobe to be picked
  int bounces = 0;
  float path_m = 0;
  glm::vec3 origin, direction;
  Hit hit;
};

/// Do image paths, short or long (long_chains.h), carry this specular chain?  The last plane is `plane` if it is given, else the end of
/// the chain.
template <int W>
bool carried(const Trace& trace, const RayState<W>& ray, const std::uint32_t* plane) {
  const int length = ray.chain_length + (plane ? 1 : 0);
  if (!ray.all_specular || length == 0) return false;
  if (length > trace.carried_order) {
    if (!trace.candidates.long_chains()) return false;
    LongChains::Chain whole = ray.long_chain;
    if (plane) trace.candidates.long_chains()->extend(whole, *plane);
    return trace.candidates.long_chains()->carries_from_listener(whole);
  }
  std::array<std::uint32_t, kMaxChain> from_source;  // candidates count from the source
  int i = 0;
  if (plane) from_source[i++] = *plane;
  for (int j = ray.chain_length - 1; j >= 0; --j) from_source[i++] = ray.chain[j];
  return trace.candidates.contains(std::span(from_source.data(), static_cast<std::size_t>(length)));
}

/// Multiplies ray.arriving by the source's gain toward `departure`.
template <int W>
void apply_emission(const Trace& trace, RayState<W>& ray, glm::vec3 departure) {
  if (!trace.emission) return;
  std::array<float, W> gain{};
  trace.emission->energy(departure, std::span(gain).first(static_cast<std::size_t>(trace.scene.num_bands())));
  for (int b = 0; b < W; ++b) ray.arriving[b] *= gain[b];
}

/// Adds ray.arriving, which the caller has found finite, at path length `path_m`.
template <int W>
void deposit(const Trace& trace, const RayState<W>& ray, float path_m, EnergyHistogram& histogram) {
  histogram.add(path_m * trace.seconds_per_m, std::span(ray.arriving, static_cast<std::size_t>(trace.scene.num_bands())),
                std::span(ray.sh.data(), static_cast<std::size_t>(trace.num_coefficients)));
}

/// Histogram and counters that a trace adds to.
struct TraceOutput {
  EnergyHistogram& histogram;
  TraceStats& stats;
};

/// Track-length estimate of the ray's present segment, which left a mirror: chord / (4 pi volume) of the source sphere.
template <int W>
void cross_source_volume(const Trace& trace, RayState<W>& ray, float segment_m, TraceOutput output) {
  const glm::vec3 origin = ray.origin, direction = ray.direction;
  const auto [enter_m, leave_m] = chord_through(trace.source, trace.source_radius_m, origin, direction, segment_m);
  if (!(leave_m > enter_m) || ray.only_walls || carried<W>(trace, ray, nullptr)) return;
  const float volume_m3 = 4.f / 3.f * kPi * trace.source_radius_m * trace.source_radius_m * trace.source_radius_m;
  const float factor = trace.weight_per_ray * (leave_m - enter_m) / (4.f * kPi * volume_m3);
  for (int b = 0; b < W; ++b) ray.arriving[b] = ray.throughput[b] * factor;
  apply_emission(trace, ray, -direction);
  if (!std::isfinite(sum_over_bands<W>(ray.arriving))) {
    ++output.stats.nonfinite_dropped;
    return;
  }
  deposit(trace, ray, ray.path_m + 0.5f * (enter_m + leave_m), output.histogram);
}

/// Multiplies ray.arriving by what the walls between two points let through, and adds to `path_m` what they delay.  False if nothing is
/// left.
template <int W>
bool pass_walls(const Trace& trace, RayState<W>& ray, glm::vec3 from, glm::vec3 to, WallRoulette<W>& roulette, float& path_m) {
  const auto num_bands = static_cast<std::size_t>(trace.scene.num_bands());
  for (int walls = 0; walls <= trace.scene.config().transmission_walls; ++walls) {
    const glm::vec3 rest = to - from;
    const float rest_m = std::sqrt(glm::dot(rest, rest));
    if (!(rest_m > 0)) return true;
    const glm::vec3 direction = rest / rest_m;
    const Hit hit = trace.scene.scene().rays().intersect(from, direction, open_length_m(to, rest_m));
    if (!hit.valid()) return true;
    const std::uint32_t material = trace.scene.scene().mesh().triangle_material[hit.triangle];
    if (!trace.walls->transmits(material) || !roulette.goes_on(ray.arriving, trace.walls->transmitted(material))) return false;
    const WallCrossing crossing = cross_wall(trace.scene.surfaces(), direction, hit, rest_m - hit.distance_m);
    if (glm::dot(to - crossing.exit, direction) <= 0) return false;
    transmit(trace.scene.surfaces(), crossing, std::span(ray.arriving, num_bands));
    path_m += extra_path_m(trace.scene.surfaces(), crossing);
    from = crossing.exit;
  }
  return false;
}

/// The point that next-event estimation aims at.
template <int W>
glm::vec3 point_of_source(const Trace& trace, const RayState<W>& ray, const RandomStream& random) {
  if (!(trace.source_spread_m > 0)) return trace.source;
  const auto u = random.uniform4(0x80000000u | static_cast<std::uint32_t>(ray.bounces));
  return point_in_sphere(trace.source, trace.source_spread_m, u[0], u[1], u[2]);
}

/// Contribution of a vertex: next-event estimation from the current position of the ray, d e = T f cos / (4 pi d^2) / (4 pi) with T
/// starting at 4 pi / N
/// and f = (1 - a) s / pi (docs/explanation/estimators.md, section 1; O-11).  blocker: see EmbreeScene::occluded; may be null.
template <int W>
void connect_vertex(const Trace& trace, RayState<W>& ray, const RandomStream& random, WallRoulette<W>& roulette, TraceOutput output,
                    std::uint32_t* blocker = nullptr) {
  const glm::vec3 start = ray.origin, source = point_of_source(trace, ray, random);
  const EmbreeScene& rays = trace.scene.scene().rays();
  const auto blocked = [&] { return blocker ? rays.occluded(start, source, *blocker) : rays.occluded(start, source); };
  const glm::vec3 to_source = source - start;
  const float distance2 = glm::dot(to_source, to_source);
  const float height_m = glm::dot(ray.hit.normal, to_source);
  if (!(height_m > 0)) return;
  const float distance_m = std::sqrt(distance2);
  float path_m = ray.path_m + distance_m;
  if (path_m > trace.max_path_m) return;
  // Without a source volume a last segment through walls would be lost.
  const bool may_pass_walls = trace.walls && trace.diffuse_last_segment;
  const bool through_walls = may_pass_walls && blocked();
  const float cosine = height_m / distance_m;
  const float geometry = trace.weight_per_ray * cosine / (4.f * kPi * kPi * std::max(distance2, trace.least_distance2_m2));
  const std::uint32_t plane = trace.scene.plane_of_triangle()[ray.hit.triangle];
  const std::uint32_t material = trace.scene.scene().mesh().triangle_material[ray.hit.triangle];
  // Image paths pass no walls: behind one the specular part is found here only.
  if (trace.diffuse_last_segment && (through_walls || !carried(trace, ray, &plane))) {
    for (int b = 0; b < W; ++b) ray.arriving[b] = ray.reflected[b] * geometry;
  } else {
    const float* scattering = trace.scene.padded_scattering(material);
    for (int b = 0; b < W; ++b) ray.arriving[b] = ray.reflected[b] * scattering[b] * geometry;
  }
  if (trace.walls) {
    // `reflected` holds what passes through as well.
    const float* transmitted = trace.walls->transmitted(material);
    for (int b = 0; b < W; ++b) ray.arriving[b] *= 1.f - transmitted[b];
  }
  apply_emission(trace, ray, -to_source / distance_m);
  const float total = sum_over_bands<W>(ray.arriving);
  if (!std::isfinite(total)) {
    ++output.stats.nonfinite_dropped;
    return;
  }
  if (!(total > 0)) return;
  ++output.stats.shadow_rays;
  if (through_walls) {
    const bool followed = roulette.begin(ray.arriving, geometry, random.uniform(0x40000000u | static_cast<std::uint32_t>(ray.bounces)));
    if (!followed || !pass_walls(trace, ray, start, source, roulette, path_m)) return roulette.lose();
    roulette.arrive(ray.arriving);
  } else if (may_pass_walls) {
    roulette.arrive_freely(geometry);
  } else if (blocked()) {
    return;
  }
  deposit(trace, ray, path_m, output.histogram);
}

/// Does the ray go straight on through the wall that it waits at?  If not, the rest of `random` is returned in it.
template <int W>
bool pick_wall(const Trace& trace, RayState<W>& ray, std::uint32_t material, float& random) {
  const float* transmitted = trace.walls->transmitted(material);
  alignas(32) float passed[W];
  for (int b = 0; b < W; ++b) passed[b] = ray.weight[b] * transmitted[b];
  const float probability = std::min(sum_over_bands<W>(passed) / static_cast<float>(trace.scene.num_bands()), 1.f);
  const bool passes = random < probability;
  const float scale = passes ? 1.f / probability : 1.f / (1.f - probability);
  for (int b = 0; b < W; ++b) {
    const float factor = (passes ? transmitted[b] : 1.f - transmitted[b]) * scale;
    ray.reflected[b] *= factor;
    ray.weight[b] *= factor;
  }
  // Rounded up to 1 it would pick a lobe of no probability.
  if (!passes) random = std::min((random - probability) * scale, kBelowOne);
  return passes;
}

/// Takes the ray through the wall that it waits at.
template <int W>
void pass_wall(const Trace& trace, RayState<W>& ray, std::uint32_t material) {
  const WallCrossing crossing = cross_wall(trace.scene.surfaces(), ray.direction, ray.hit);
  for (int b = 0; b < W; ++b) ray.throughput[b] = ray.reflected[b];
  if (crossing.inside_m > 0.f) {
    // `passed` includes tau already; absorption inside the wall is added here.
    const auto tau = trace.scene.transmission(material);
    transmit(trace.scene.surfaces(), crossing, std::span(ray.throughput, tau.size()));
    for (std::size_t b = 0; b < tau.size(); ++b) ray.throughput[b] = tau[b] > 0.f ? ray.throughput[b] / tau[b] : 0.f;
  }
  ray.path_m += crossing.inside_m + extra_path_m(trace.scene.surfaces(), crossing);
  ray.origin = crossing.exit;
  ray.all_specular = false;  // image paths pass no walls
  ray.after_mirror = true;
}

/// Parts the ray at the wall that it waits at: the ray keeps what the wall does not let through, the one that is returned has gone
/// through with the rest.  No choice, so no density changes.
template <int W, class Ray>
Ray part_at_wall(const Trace& trace, Ray& ray, std::uint32_t material) {
  Ray through = ray;
  const float* transmitted = trace.walls->transmitted(material);
  for (int b = 0; b < W; ++b) {
    through.reflected[b] *= transmitted[b];
    ray.reflected[b] *= 1.f - transmitted[b];
  }
  pass_wall<W>(trace, through, material);
  through.at_vertex = false;
  return through;
}

/// Picks diffuse or mirror and updates throughput and weight.  Returns true for diffuse.
template <int W>
bool pick_lobe(RayState<W>& ray, const float* scattering, int num_bands, float random) {
  alignas(32) float diffuse[W];
  for (int b = 0; b < W; ++b) diffuse[b] = ray.weight[b] * scattering[b];
  const float probability = std::min(sum_over_bands<W>(diffuse) / static_cast<float>(num_bands), 1.f);
  if (random < probability) {
    const float scale = 1.f / probability;
    for (int b = 0; b < W; ++b) {
      const float factor = scattering[b] * scale;
      ray.throughput[b] = ray.reflected[b] * factor;
      ray.weight[b] *= factor;
    }
    return true;
  }
  const float scale = 1.f / (1.f - probability);
  for (int b = 0; b < W; ++b) {
    const float factor = (1.f - scattering[b]) * scale;
    ray.throughput[b] = ray.reflected[b] * factor;
    ray.weight[b] *= factor;
  }
  return false;
}

/// Ends a ray that carries nothing, or nothing finite.
template <int W>
void end_if_spent(RayState<W>& ray, TraceStats& stats) {
  const float total = sum_over_bands<W>(ray.throughput);
  if (!std::isfinite(total)) ++stats.nonfinite_dropped;
  if (!(total > 0) || !std::isfinite(total)) ray.alive = false;
}

/// Goes on from the vertex that the ray waits at: lobe and direction.  Ends the ray if nothing more can come of it.  stays: what goes
/// through the wall has been taken from `reflected`, and another ray carries it.
template <int W>
void leave_vertex(const Trace& trace, RayState<W>& ray, const RandomStream& random, TraceStats& stats, bool stays = false) {
  const AcousticScene& scene = trace.scene;
  const Hit& hit = ray.hit;
  const float* scattering = scene.padded_scattering(scene.scene().mesh().triangle_material[hit.triangle]);
  std::array<float, 4> u = random.uniform4(static_cast<std::uint32_t>(ray.bounces));
  if (trace.walls) {
    const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
    if (!stays && trace.walls->transmits(material) && pick_wall(trace, ray, material, u[2])) {
      pass_wall(trace, ray, material);
      ray.at_vertex = false;
      end_if_spent(ray, stats);
      return;
    }
    ray.only_walls = false;
  }
  const bool diffuse = pick_lobe(ray, scattering, scene.num_bands(), u[2]);
  ray.at_vertex = false;
  ray.after_mirror = !diffuse;
  if (diffuse) {
    ray.all_specular = false;
    ray.direction = lambert_direction(hit.normal, u[0], u[1]);
  } else {
    if (ray.all_specular) {
      const std::uint32_t plane = scene.plane_of_triangle()[hit.triangle];
      if (ray.chain_length < kMaxChain) ray.chain[static_cast<std::size_t>(ray.chain_length)] = plane;
      ++ray.chain_length;
      if (trace.candidates.long_chains()) trace.candidates.long_chains()->extend(ray.long_chain, plane);
    }
    if (const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle]; scene.surfaces().reacts_locally(material))
      scene.surfaces().scale_by_angle(material, double{std::abs(glm::dot(ray.direction, hit.normal))},
                                      std::span(ray.throughput).first(static_cast<std::size_t>(scene.num_bands())));
    ray.direction = mirror_direction(ray.direction, hit.normal);
  }
  // The last bounce goes on only for the sake of the source volume behind a mirror.
  if (ray.bounces == trace.max_bounces && (diffuse || trace.source_radius_m == 0)) ray.alive = false;
  end_if_spent(ray, stats);
}

/// Notes the vertex that a ray waits at.
template <int W>
void record_vertex(RayState<W>& ray, std::uint32_t slot, std::uint32_t stage, ListenerPaths& paths) {
  const ListenerPaths::Vertex vertex{.start = ray.origin,
                                     .normal = ray.hit.normal,
                                     .triangle = ray.hit.triangle,
                                     .path_m = ray.path_m,
                                     .bounces = static_cast<std::uint32_t>(ray.bounces),
                                     .first = ray.first,
                                     .slot = slot,
                                     .stage = stage,
                                     .parent = ray.vertex,
                                     .chain_length = static_cast<std::uint32_t>(ray.chain_length),
                                     .all_specular = ray.all_specular};
  ray.vertex = paths.add(vertex, ray.reflected);
}

/// Puts a ray where it was when the vertex was recorded, as far as connect_vertex() asks.  Vertices are recalled in their order.  sh: of
/// the ray's first direction.
template <int W>
void recall_vertex(const Trace& trace, ListenerPaths& paths, std::uint32_t index, const float* sh, RayState<W>& ray) {
  const std::span<const ListenerPaths::Vertex> vertices = paths.vertices();
  const ListenerPaths::Vertex& vertex = vertices[index];
  std::copy_n(paths.reflected(index, W), W, ray.reflected);
  std::copy_n(sh, trace.num_coefficients, ray.sh.data());
  ray.origin = vertex.start;
  ray.hit.normal = vertex.normal;
  ray.hit.triangle = vertex.triangle;
  ray.path_m = vertex.path_m;
  ray.bounces = static_cast<int>(vertex.bounces);
  ray.all_specular = vertex.all_specular;
  if (!vertex.all_specular) return;
  // All mirrors before it are vertices as well, back to the listener.
  const auto plane_of = [&](std::uint32_t v) { return trace.scene.plane_of_triangle()[vertices[v].triangle]; };
  ray.chain_length = static_cast<int>(vertex.chain_length);
  std::uint32_t before = vertex.parent;
  for (int i = ray.chain_length; i-- > 0 && ray.chain_length <= kMaxChain; before = vertices[before].parent)
    ray.chain[static_cast<std::size_t>(i)] = plane_of(before);
  const LongChains* long_chains = trace.candidates.long_chains().get();
  if (long_chains == nullptr) return;
  ray.long_chain = {};
  if (vertex.chain_length > 0) {
    ray.long_chain = paths.long_chains[vertex.parent];
    long_chains->extend(ray.long_chain, plane_of(vertex.parent));
  }
  paths.long_chains[index] = ray.long_chain;
}

/// Follows a ray until it has gone `until_m` and stands at a vertex, or ends.  visit(): at each vertex.  part(material): before the ray
/// leaves one; whether another ray carries what goes through the wall there.
template <int W, class Visit, class Part>
void advance(const Trace& trace, RayState<W>& ray, float until_m, const RandomStream& random, const Visit& visit, const Part& part,
             TraceOutput output) {
  const AcousticScene& scene = trace.scene;
  while (true) {
    if (ray.at_vertex) {
      if (ray.path_m >= until_m) return;
      leave_vertex(trace, ray, random, output.stats, part(scene.scene().mesh().triangle_material[ray.hit.triangle]));
      if (!ray.alive) return;
    }
    const Hit hit = scene.scene().rays().intersect(ray.origin, ray.direction);
    ++(hit.valid() ? output.stats.ray_hits : output.stats.ray_escapes);
    if (ray.after_mirror && trace.source_radius_m > 0) cross_source_volume(trace, ray, hit.distance_m, output);
    ray.path_m += hit.distance_m;
    ray.alive = hit.valid() && ray.bounces < trace.max_bounces && ray.path_m < trace.max_path_m;
    if (!ray.alive) return;

    const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
    const float* kept = trace.walls ? trace.walls->kept(material) : scene.padded_reflectance(material);
    for (int b = 0; b < W; ++b) ray.reflected[b] = ray.throughput[b] * kept[b];
    ray.hit = hit;
    ray.origin = offset_from_surface(hit.position, hit.normal);
    ray.at_vertex = true;
    ++ray.bounces;
    visit();
  }
}

}  // namespace earshot::listener_ray
