// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/tracers/source_subpath.h"
#include "sim/audio/head/ambisonics.h"

/// Subpaths from the listener and all ways in which they meet the source and its subpaths.  Internal to the tracer.
///
/// Normalisation: with densities and throughputs as in docs/explanation/estimators.md, section 1, and O-11, the factors 4 pi of both ends
/// cancel: a listener ray starts with 1 / rays, a source path with 1, and a connection adds  T_listener f G f T_source / (probability of
/// the source vertex) * weight.
namespace earshot {

/// The source subpaths of one batch: [path][event].
template <int W>
struct SourceSubpaths {
  std::span<const SourceVertex<W>> vertices;
  std::uint32_t num_paths = 0, num_events = 0;
};

template <int W>
struct ListenerRay : SubpathEnergy<W> {
  static constexpr int kMaxImageOrder = 4;
  std::array<float, kMaxCoefficients> sh;              // of the first direction: all that comes along this ray arrives from there
  std::array<std::uint32_t, kMaxImageOrder> planes{};  // of a path of mirrors only, listener first
  int num_planes = 0;
  LongChains::Chain long_chain;                 // the same, of any length
  bool only_mirrors = true, only_walls = true;  // so far: every event a mirror, or a wall passed straight
  bool alive = true, at_vertex = false;         // at_vertex: `hit` waits for the ray to leave it
  bool after_pass = false;                      // the last event was a mirror or a passed wall
  bool first_edge_open = false;                 // the edge at the listener can be connected
  int last_open_event = 0;                      // the later end of the last inner edge that can be connected; 0: none
  int events = 0;
  float path_m = 0;
  alignas(32) float image[W];  // of a path of mirrors only: energy of its image over that of a free path as long
  float split = 1;             // factor of population control on its energy: copies of one ray are caught together
  glm::vec3 origin{0}, direction{0};
  Hit hit;
  mis::ListenerChain chain;
};

/// One batch's way to deposit energy.
template <int W>
struct BatchOutput {
  EnergyHistogram& histogram;
  TraceStats& stats;
  float seconds_per_m;
  std::size_t num_bands, num_coefficients;
  std::span<float> unseen;  // LateBatches::unseen; empty: not kept
  float batches;            // their number
  float path_weight;        // of each path that is deposited: 1 / (paths of this batch)

  /// Notes `energy` that could come once in a length of `spacing_m` about path_m.
  void note_unseen(const float (&energy)[W], float path_m, float spacing_m) {
    const auto first = static_cast<std::size_t>(path_m * seconds_per_m / histogram.bin_s()) * num_bands;
    if (first + num_bands > unseen.size()) return;
    const float per_bin = std::min(histogram.bin_s() / (seconds_per_m * spacing_m), 1.f);
    for (std::size_t b = 0; b < num_bands; ++b) unseen[first + b] = std::max(unseen[first + b], per_bin * energy[b]);
  }

  /// Adds `energy` unless it is zero or not finite.  blocked() is only called if there is something to add.
  template <class Blocked>
  void deposit(const float (&energy)[W], float path_m, const float* sh, Blocked blocked) {
    const float total = sum_over_bands<W>(energy);
    if (!std::isfinite(total)) {
      ++stats.nonfinite_dropped;
      return;
    }
    if (!(total > 0.f) || blocked()) return;
    histogram.add(path_m * seconds_per_m, std::span(energy, num_bands), std::span(sh, num_coefficients));
  }
};

/// Do image paths, short or long, or the straight path through walls carry this path?
template <int W>
bool carried(const BidirectionalScene& shared, const ListenerRay<W>& ray) {
  if (ray.only_walls) return true;
  if (!ray.only_mirrors) return false;
  if (ray.events > shared.carried_order)
    return shared.candidates.long_chains() && shared.candidates.long_chains()->carries_from_listener(ray.long_chain);
  if (ray.num_planes != ray.events) return false;
  std::array<std::uint32_t, ListenerRay<W>::kMaxImageOrder> from_source;
  for (int i = 0; i < ray.num_planes; ++i) from_source[i] = ray.planes[ray.num_planes - 1 - i];
  return shared.candidates.contains(std::span(from_source.data(), static_cast<std::size_t>(ray.num_planes)));
}

/// Can any strategy make the path that ends at the source behind the last event?
template <int W>
bool some_strategy_connects(const BidirectionalScene& shared, const ListenerRay<W>& ray) {
  const mis::Strategies& s = shared.strategies;
  if (s.to_listener > 0 && ray.first_edge_open && ray.events <= s.source_bounces) return true;
  return s.connection > 0 && ray.last_open_event > 0 && ray.events - ray.last_open_event + 1 <= s.source_bounces;
}

/// Upper limit for the energy of a chain of mirrors in which no ray was caught.  A count of k has an upper limit of 97.7 % of k + 2
/// sqrt(k + 3/4) + 7/4 (Gehrels 1986, eq. 10): half of it for k = 0, 1.74 rays, stands for one standard error beside the spread of batches.
/// One ray is caught again and again, at every second segment, until its beam has spread, half of the times within an octave of length; the
/// mean chord of a sphere is 4 r / 3.  But no chain holds more than the two images that come in such a length.
template <int W>
void note_unseen_chain(const BidirectionalScene& shared, const ListenerRay<W>& ray, float path_m, BatchOutput<W>& output) {
  constexpr float pi = std::numbers::pi_v<float>, rays = 1.74f / 2;
  const float radius_m = shared.volume_radius_m;
  const float catches = rays * output.path_weight / (output.batches * std::min(ray.split, 1.f) * 4.f * pi * pi * radius_m * radius_m);
  const float images = 2.f / (16.f * pi * pi * path_m * path_m);
  alignas(32) float energy[W];
  for (int b = 0; b < W; ++b) energy[b] = std::min(catches * ray.arriving[b], images * ray.image[b]);
  apply_emission(shared, -ray.direction, energy);
  output.note_unseen(energy, path_m, 2.f * ray.path_m / static_cast<float>(ray.events));
}

/// Paths that no strategy connects: chord of the segment through the source's sphere over 4 pi times its volume
/// (docs/explanation/estimators.md, section 2).
template <int W>
void catch_in_volume(const BidirectionalScene& shared, const ListenerRay<W>& ray, float segment_m, BatchOutput<W>& output) {
  const float radius_m = shared.volume_radius_m;
  const Chord chord = chord_through(shared.source, radius_m, ray.origin, ray.direction, segment_m);
  const bool missed = !(chord.leave_m > chord.enter_m), noted = ray.only_mirrors && !output.unseen.empty() && radius_m > 0.f;
  if ((missed && !noted) || some_strategy_connects(shared, ray) || carried(shared, ray)) return;
  if (noted && segment_m < shared.max_path_m) note_unseen_chain(shared, ray, ray.path_m + 0.5f * segment_m, output);
  if (missed) return;
  constexpr float pi = std::numbers::pi_v<float>;
  const float volume_m3 = 4.f / 3.f * pi * radius_m * radius_m * radius_m;
  const float factor = output.path_weight * (chord.leave_m - chord.enter_m) / (4.f * pi * volume_m3);
  alignas(32) float energy[W];
  for (int b = 0; b < W; ++b) energy[b] = ray.arriving[b] * factor;
  apply_emission(shared, -ray.direction, energy);
  output.deposit(energy, ray.path_m + 0.5f * (chord.enter_m + chord.leave_m), ray.sh.data(), [] { return false; });
}

/// Strategy 0: connects the listener's vertex to the source.
template <int W>
void connect_to_source(const BidirectionalScene& shared, const ListenerRay<W>& ray, std::uint32_t material, glm::vec3 source,
                       BatchOutput<W>& output) {
  const glm::vec3 to_source = source - ray.origin, normal = ray.hit.normal, in = -ray.direction;
  const float height_m = glm::dot(normal, to_source);
  if (!(height_m > 0.f)) return;
  const float distance2 = glm::dot(to_source, to_source), distance_m = std::sqrt(distance2);
  if (ray.path_m + distance_m > shared.max_path_m) return;
  const glm::vec3 out = to_source / distance_m;
  const float cosine = height_m / distance_m;
  float factor = output.path_weight * cosine / (4.f * std::numbers::pi_v<float> * std::max(distance2, shared.least_distance2_m2));
  alignas(32) float energy[W];
  rough_value<W>(shared.model, material, normal, in, out, energy);
  for (int b = 0; b < W; ++b) energy[b] *= ray.reflected[b];
  if (!(sum_over_bands<W>(energy) > 0.f)) return;
  const mis::Strategies& strategies = shared.strategies;
  if (strategies.source_bounces > 0) {
    const double later = ray.chain.later(strategies, ray.events, 0, mis::area_pdf(mis::kPointPdf, cosine, distance_m),
                                         shared.model.mean_pdf(material, normal, out, in));
    factor *= static_cast<float>(mis::weight(strategies.next_event, 0, later) / strategies.next_event);
  }
  for (int b = 0; b < W; ++b) energy[b] *= factor;
  apply_emission(shared, -out, energy);
  output.deposit(energy, ray.path_m + distance_m, ray.sh.data(), [&] {
    ++output.stats.shadow_rays;
    return shared.scene.scene().rays().occluded(ray.origin, source);
  });
}

/// Strategy i = source_event: connects the listener's vertex to the source's.
template <int W>
void connect_to_vertex(const BidirectionalScene& shared, const ListenerRay<W>& ray, std::uint32_t material, const SourceVertex<W>& vertex,
                       int source_event, BatchOutput<W>& output) {
  if (!vertex.exists || ray.events + source_event > shared.max_bounces) return;
  const glm::vec3 between = vertex.position - ray.origin, normal = ray.hit.normal, in = -ray.direction;
  const float height_here = glm::dot(normal, between), height_there = -glm::dot(vertex.normal, between);
  if (!(height_here > 0.f && height_there > 0.f)) return;
  const float distance2 = glm::dot(between, between), distance_m = std::sqrt(distance2);
  const float path_m = ray.path_m + distance_m + vertex.path_m;
  if (path_m > shared.max_path_m || distance_m < shared.strategies.least_edge_m) return;
  const glm::vec3 out = between / distance_m;
  const float cos_here = height_here / distance_m, cos_there = height_there / distance_m;
  alignas(32) float energy[W], vertex_value[W];
  rough_value<W>(shared.model, material, normal, in, out, energy);
  rough_value<W>(shared.model, vertex.material, vertex.normal, vertex.toward_previous, -out, vertex_value);
  for (int b = 0; b < W; ++b) energy[b] *= ray.reflected[b] * vertex_value[b] * vertex.reflected[b];
  if (!(sum_over_bands<W>(energy) > 0.f)) return;

  const mis::Strategies& strategies = shared.strategies;
  const ReflectionModel& model = shared.model;
  const double later =
      ray.chain.later(strategies, ray.events, source_event,
                      mis::area_pdf(model.mean_pdf(vertex.material, vertex.normal, vertex.toward_previous, -out), cos_here, distance_m),
                      model.mean_pdf(material, normal, out, in));
  const double earlier = vertex.end.earlier(mis::area_pdf(model.mean_pdf(material, normal, in, out), cos_there, distance_m),
                                            model.mean_pdf(vertex.material, vertex.normal, -out, vertex.toward_previous));
  const double weight = mis::weight(strategies.connection, earlier, later) / strategies.connection;
  const float factor =
      output.path_weight * cos_here * cos_there / std::max(distance2, shared.least_distance2_m2) * static_cast<float>(weight);
  for (int b = 0; b < W; ++b) energy[b] *= factor;
  output.deposit(energy, path_m, ray.sh.data(), [&] {
    ++output.stats.shadow_rays;
    return shared.scene.scene().rays().occluded(ray.origin, vertex.position);
  });
}

/// Strategy k: connects the source's vertex to the listener.
template <int W>
void connect_to_listener(const BidirectionalScene& shared, const SourceVertex<W>& vertex, BatchOutput<W>& output) {
  const glm::vec3 to_listener = shared.listener - vertex.position;
  const float height_m = glm::dot(vertex.normal, to_listener);
  if (!vertex.exists || !(height_m > 0.f)) return;
  const float distance2 = glm::dot(to_listener, to_listener), distance_m = std::sqrt(distance2);
  if (vertex.path_m + distance_m > shared.max_path_m) return;
  const glm::vec3 out = to_listener / distance_m;
  const float cosine = height_m / distance_m;
  alignas(32) float energy[W];
  rough_value<W>(shared.model, vertex.material, vertex.normal, vertex.toward_previous, out, energy);
  for (int b = 0; b < W; ++b) energy[b] *= vertex.reflected[b];
  if (!(sum_over_bands<W>(energy) > 0.f)) return;
  const double earlier = vertex.end.earlier(mis::area_pdf(mis::kPointPdf, cosine, distance_m),
                                            shared.model.mean_pdf(vertex.material, vertex.normal, out, vertex.toward_previous));
  const auto weight = static_cast<float>(mis::weight(shared.strategies.to_listener, earlier, 0));
  const float factor =
      output.path_weight * weight * cosine / (4.f * std::numbers::pi_v<float> * std::max(distance2, shared.least_distance2_m2));
  for (int b = 0; b < W; ++b) energy[b] *= factor;
  std::array<float, kMaxCoefficients> sh;
  spherical_harmonics_n3d(-out, shared.sh_order, std::span(sh).first(output.num_coefficients));
  output.deposit(energy, vertex.path_m + distance_m, sh.data(), [&] {
    ++output.stats.shadow_rays;
    return shared.scene.scene().rays().occluded(vertex.position, shared.listener);
  });
}

template <int W>
void start_ray(const BidirectionalScene& shared, glm::vec3 direction, ListenerRay<W>& ray) {
  for (int b = 0; b < W; ++b) ray.arriving[b] = ray.weight[b] = ray.image[b] = b < shared.scene.num_bands() ? 1.f : 0.f;
  ray.origin = shared.listener;
  ray.direction = direction;
  spherical_harmonics_n3d(direction, shared.sh_order, std::span(ray.sh).first(static_cast<std::size_t>(shared.num_coefficients)));
}

/// Goes on from the vertex that the ray waits at.  Ends the ray if nothing more can come of it.
template <int W>
void leave_vertex(const BidirectionalScene& shared, ListenerRay<W>& ray, const std::array<float, 4>& u, TraceStats& stats) {
  const glm::vec3 in = -ray.direction, normal = ray.hit.normal;
  const std::uint32_t material = shared.scene.scene().mesh().triangle_material[ray.hit.triangle];
  const auto [leaving, extra_path_m] = leave_surface<W>(shared.scene, ray.hit, u, ray, ray.origin, ray.direction);
  ray.at_vertex = false;
  ray.after_pass = leaving != Leaving::rough;
  ray.path_m += extra_path_m;
  ray.only_walls = ray.only_walls && leaving == Leaving::through;
  ray.only_mirrors = ray.only_mirrors && leaving == Leaving::mirror;
  if (ray.only_mirrors) {
    const float *kept = shared.model.kept(material), *mirror = shared.model.mirror(material);
    for (int b = 0; b < W; ++b) ray.image[b] *= kept[b] * mirror[b];
    if (shared.scene.surfaces().reacts_locally(material))
      shared.scene.surfaces().scale_by_angle(material, double{std::abs(glm::dot(in, normal))},
                                             std::span(ray.image).first(static_cast<std::size_t>(shared.scene.num_bands())));
    const std::uint32_t plane = shared.scene.plane_of_triangle()[ray.hit.triangle];
    if (ray.num_planes < ListenerRay<W>::kMaxImageOrder) ray.planes[ray.num_planes++] = plane;
    if (shared.candidates.long_chains()) shared.candidates.long_chains()->extend(ray.long_chain, plane);
  }
  mis::Segment& segment = ray.chain.segment();
  if (leaving != Leaving::rough) {
    segment.pass(ray.hit.distance_m + extra_path_m);
  } else {
    if (segment.direct && segment.from_point) ray.first_edge_open = true;
    if (segment.direct && !segment.from_point && mis::samples_of_edge(shared.strategies, ray.hit.distance_m) > 0)
      ray.last_open_event = ray.events;
    ray.chain.leave(shared.strategies, ray.events, shared.model.mean_pdf(material, normal, in, ray.direction),
                    shared.model.mean_pdf(material, normal, ray.direction, in), glm::dot(normal, ray.direction));
  }
  // The last bounce goes on only for the sake of the source volume behind a mirror or a wall.
  if (ray.events == shared.max_bounces && leaving == Leaving::rough) ray.alive = false;
  const float total = sum_over_bands<W>(ray.arriving);
  if (!std::isfinite(total)) ++stats.nonfinite_dropped;
  if (!(total > 0.f) || !std::isfinite(total)) ray.alive = false;
}

/// The part of a ray between two rounds of population control.
struct RayStage {
  std::uint32_t slot;  // which source paths the ray is paired with
  float until_m;       // it ends at the first vertex from this path length on
  RandomStream random;
};

/// Follows a ray until it stands at the end of a stage, or ends.
template <int W>
void advance(const BidirectionalScene& shared, const SourceSubpaths<W>& sources, const RayStage& stage, ListenerRay<W>& ray,
             BatchOutput<W>& output) {
  const AcousticScene& scene = shared.scene;
  while (true) {
    if (ray.at_vertex) {
      if (ray.path_m >= stage.until_m) return;
      leave_vertex(shared, ray, stage.random.uniform4(static_cast<std::uint32_t>(ray.events)), output.stats);
      if (!ray.alive) return;
    }
    ray.hit = scene.scene().rays().intersect(ray.origin, ray.direction);
    ++(ray.hit.valid() ? output.stats.ray_hits : output.stats.ray_escapes);
    if (ray.after_pass) catch_in_volume(shared, ray, ray.hit.distance_m, output);
    ray.path_m += ray.hit.distance_m;
    ray.alive = ray.hit.valid() && ray.events < shared.max_bounces && ray.path_m < shared.max_path_m;
    if (!ray.alive) return;

    const std::uint32_t material = scene.scene().mesh().triangle_material[ray.hit.triangle];
    meet_surface<W>(shared.model, material, ray);
    ray.origin = offset_from_surface(ray.hit.position, ray.hit.normal);
    ray.at_vertex = true;
    ++ray.events;
    ray.chain.arrive(-glm::dot(ray.hit.normal, ray.direction), ray.hit.distance_m);
    constexpr std::uint32_t second_set = 0x80000000u;
    const std::array<float, 4> u = stage.random.uniform4(second_set | static_cast<std::uint32_t>(ray.events));
    const auto connected = static_cast<float>(shared.strategies.connected);
    if (u[0] >= connected) continue;  // the rest of u[0] selects the event below
    if (shared.strategies.next_event > 0) {
      connect_to_source(shared, ray, material, point_of_source(shared, u[1], u[2], u[3]), output);
    }
    if (shared.strategies.connection > 0) {
      // Another path at each vertex: neighbours on one ray do not share the luck of one path.
      const std::uint32_t path = (stage.slot + static_cast<std::uint32_t>(ray.events) * 7919u) % sources.num_paths;
      const auto event =
          std::min(static_cast<std::uint32_t>(u[0] / connected * static_cast<float>(sources.num_events)), sources.num_events - 1);
      connect_to_vertex(shared, ray, material, sources.vertices[std::size_t{path} * sources.num_events + event],
                        static_cast<int>(event) + 1, output);
    }
  }
}

}  // namespace earshot
