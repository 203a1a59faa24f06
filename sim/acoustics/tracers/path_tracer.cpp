// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/path_tracer.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/core/histogram_sum.h"
#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/tracers/listener_ray.h"
#include "sim/acoustics/tracers/population_control.h"
#include "sim/acoustics/tracers/source_volume.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/base/denormals.h"
#include "sim/base/random.h"

namespace earshot {
using listener_ray::advance;
using listener_ray::connect_vertex;
using listener_ray::RayState;
using listener_ray::recall_vertex;
using listener_ray::record_vertex;
using listener_ray::Trace;

namespace {

constexpr std::uint32_t kChunksPerWave = 16;  // histograms held at once

int num_bins(const AcousticConfig& config) {
  // A hair's breadth against 0.5f / 0.004f = 125.0000001.
  return static_cast<int>(std::ceil(double{config.rir_length_s} / config.time_bin_s * (1.0 - 1e-6)));
}

/// paths: records the vertices; may be null.
template <int W>
void trace_chunk(const Trace& trace, std::uint32_t chunk, ListenerPaths* paths, EnergyHistogram& histogram, TraceStats& stats) {
  const std::uint64_t seed = trace.scene.config().seed;
  const std::uint32_t first = chunk * kRaysPerChunk;
  std::array<RayState<W>, kRaysPerChunk> storage;
  const auto rays = std::span(storage).first(std::min(kRaysPerChunk, trace.num_rays - first));
  for (std::uint32_t i = 0; i < rays.size(); ++i) {
    RayState<W>& ray = rays[i];
    for (int b = 0; b < W; ++b) ray.throughput[b] = ray.weight[b] = b < trace.scene.num_bands() ? 1.f : 0.f;
    ray.only_walls = trace.walls != nullptr;
    ray.first = first + i;
    ray.origin = trace.listener;
    ray.direction = trace.directions.direction(first + i);
    // All that comes along this ray arrives from its first direction.
    spherical_harmonics_n3d(ray.direction, trace.sh_order, ray.sh);
  }
  WallRoulette<W> roulette;
  std::uint64_t of_connections = 0;  // of what was not finite
  for (std::uint32_t stage = 0;; ++stage) {
    const float until_m = static_cast<float>(stage + 1) * trace.stage_m;
    bool any_alive = false;
    for (std::uint32_t i = 0; i < rays.size(); ++i) {
      if (!rays[i].alive) continue;
      // A slot draws new numbers in each stage, whichever ray it holds.
      const RandomStream random(seed, Purpose::scatter, first + i, stage);
      const auto visit = [&] {
        if (paths != nullptr) record_vertex(rays[i], first + i, stage, *paths);
        const std::uint64_t before = stats.nonfinite_dropped;
        connect_vertex(trace, rays[i], random, roulette, {histogram, stats});
        of_connections += stats.nonfinite_dropped - before;
      };
      advance(trace, rays[i], until_m, random, visit, {histogram, stats});
      any_alive = any_alive || rays[i].alive;
    }
    if (!any_alive) break;
    stats.nonfinite_dropped += static_cast<std::uint64_t>(
        control_population<W>(trace.scene.num_bands(), rays, RandomStream(seed, Purpose::roulette, chunk, stage).uniform(0)));
  }
  if (paths != nullptr) paths->counters = {stats.ray_hits, stats.ray_escapes, stats.nonfinite_dropped - of_connections};
}

/// The same connections in the same order from vertices that were recorded.
template <int W>
void connect_chunk(const Trace& trace, ListenerPaths& paths, EnergyHistogram& histogram, TraceStats& stats) {
  std::array<std::array<float, kMaxCoefficients>, kRaysPerChunk> sh;
  for (std::uint32_t i = 0; i < trace.num_rays; ++i) spherical_harmonics_n3d(trace.directions.direction(i), trace.sh_order, sh[i]);
  const std::span<ListenerPaths::Vertex> vertices = paths.vertices();
  if (trace.candidates.long_chains()) paths.long_chains.resize(vertices.size());
  RayState<W> ray;
  WallRoulette<W> roulette;
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    recall_vertex(trace, paths, i, sh[vertices[i].first].data(), ray);
    const RandomStream random(trace.scene.config().seed, Purpose::scatter, vertices[i].slot, vertices[i].stage);
    connect_vertex(trace, ray, random, roulette, {histogram, stats}, &vertices[i].blocker);
  }
  stats.ray_hits += paths.counters.ray_hits;
  stats.ray_escapes += paths.counters.ray_escapes;
  stats.nonfinite_dropped += paths.counters.nonfinite_dropped;
}

/// paths: null in all but traces of one chunk.
void trace_chunk(const Trace& trace, std::uint32_t chunk, ListenerPaths* paths, ListenerPaths::Use use, EnergyHistogram& histogram,
                 TraceStats& stats) {
  const std::size_t width = static_cast<std::size_t>(trace.scene.padded_bands()) / 8 - 1;
  static_assert(kMaxBands == 32);
  if (use == ListenerPaths::Use::replay) {
    using ConnectChunk = void (*)(const Trace&, ListenerPaths&, EnergyHistogram&, TraceStats&);
    constexpr ConnectChunk by_width[] = {connect_chunk<8>, connect_chunk<16>, connect_chunk<24>, connect_chunk<32>};
    return by_width[width](trace, *paths, histogram, stats);
  }
  using TraceChunk = void (*)(const Trace&, std::uint32_t, ListenerPaths*, EnergyHistogram&, TraceStats&);
  constexpr TraceChunk by_width[] = {trace_chunk<8>, trace_chunk<16>, trace_chunk<24>, trace_chunk<32>};
  by_width[width](trace, chunk, use == ListenerPaths::Use::record ? paths : nullptr, histogram, stats);
}

/// Chunks in waves; chunk histograms are summed in double and in the order of the chunks, so threads cannot change a bit.
void trace_chunks(const Trace& trace, std::uint32_t num_chunks, EnergyHistogram& histogram, TraceStats& stats) {
  const int threads = trace.scene.config().threads;
  const std::uint32_t wave_size = std::min(num_chunks, threads == 1 ? 1u : kChunksPerWave);
  std::vector<EnergyHistogram> parts(wave_size, make_histogram(trace.scene));
  std::vector<TraceStats> part_stats(wave_size);
  HistogramSum sum(histogram);
  const int available = tbb::this_task_arena::max_concurrency();
  tbb::task_arena arena(threads == 0 ? available : std::min(threads, available));

  for (std::uint32_t first = 0; first < num_chunks; first += wave_size) {
    const std::uint32_t count = std::min(wave_size, num_chunks - first);
    const auto run = [&](std::uint32_t i) {
      const FlushDenormals flush;
      parts[i].clear();
      part_stats[i] = {};
      trace_chunk(trace, first + i, nullptr, ListenerPaths::Use::none, parts[i], part_stats[i]);
    };
    if (threads == 1) {
      for (std::uint32_t i = 0; i < count; ++i) run(i);
    } else {
      arena.execute([&] { tbb::parallel_for(0u, count, run); });
    }
    for (std::uint32_t i = 0; i < count; ++i) {
      sum.add(parts[i]);
      stats.add(part_stats[i]);
    }
  }
  sum.write(histogram);
}

}  // namespace

void TraceStats::add(const TraceStats& part) {
  ray_hits += part.ray_hits;
  ray_escapes += part.ray_escapes;
  shadow_rays += part.shadow_rays;
  nonfinite_dropped += part.nonfinite_dropped;
}

double TraceStats::ray_efficiency() const {
  const std::uint64_t segments = ray_hits + ray_escapes;
  return segments == 0 ? 0.0 : static_cast<double>(ray_hits) / static_cast<double>(segments);
}

EnergyHistogram make_histogram(const AcousticScene& scene) {
  const AcousticConfig& config = scene.config();
  return EnergyHistogram(num_bins(config), scene.num_bands(), config.sh_order, config.time_bin_s);
}

bool has_shape_of(const AcousticScene& scene, const EnergyHistogram& histogram) {
  const AcousticConfig& config = scene.config();
  return histogram.num_bins() == num_bins(config) && histogram.num_bands() == scene.num_bands() &&
         histogram.num_coefficients() == (config.sh_order + 1) * (config.sh_order + 1) && histogram.bin_s() == config.time_bin_s;
}

TraceStats trace_late(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyHistogram& histogram,
                      ListenerPaths* paths) {
  const FlushDenormals flush;
  const AcousticConfig& config = scene.config();
  histogram.clear();
  TraceStats stats;
  const auto num_rays = static_cast<std::uint32_t>(config.rays);
  if (config.late == Switch::off || num_rays == 0 || config.max_bounces == 0) return stats;
  stats.rays = num_rays;

  const auto shift = RandomStream(config.seed, Purpose::listener_ray).bits4(0);
  const float spread_m = candidates.sound_source().radius_m;
  const float least_distance_m = kMinDistanceFraction * scene.diagonal_m();
  const Trace trace{.scene = scene,
                    .candidates = candidates,
                    .emission = candidates.emission().omnidirectional() ? nullptr : &candidates.emission(),
                    .walls = traces_transmission(scene) ? &scene.reflection_model() : nullptr,
                    .source = candidates.source(),
                    .listener = listener,
                    .directions = {shift[0], shift[1]},
                    .num_rays = num_rays,
                    .max_bounces = config.max_bounces,
                    .carried_order = scene.image_order(),
                    .sh_order = config.sh_order,
                    .num_coefficients = histogram.num_coefficients(),
                    .weight_per_ray = 1.f / static_cast<float>(num_rays),
                    .max_path_m = scene.max_path_m(),
                    .seconds_per_m = 1.f / scene.speed_of_sound_m_per_s(),
                    .stage_m = std::max(kStageOfDiagonal * scene.diagonal_m(), 1e-4f * scene.max_path_m()),
                    .least_distance2_m2 = least_distance_m * least_distance_m,
                    .source_radius_m = config.diffuse_last_segment ? 0.f
                                       : spread_m > 0.f            ? spread_m
                                                                   : free_radius_m(scene, candidates.source()),
                    .source_spread_m = spread_m,
                    .diffuse_last_segment = config.diffuse_last_segment};
  const std::uint32_t num_chunks = (num_rays + kRaysPerChunk - 1) / kRaysPerChunk;
  if (num_chunks == 1) {
    const bool kept = paths != nullptr && trace.source_radius_m == 0;
    trace_chunk(trace, 0, paths, kept ? paths->next(scene.hash(), listener) : ListenerPaths::Use::none, histogram, stats);
  } else {
    trace_chunks(trace, num_chunks, histogram, stats);
  }
  histogram.attenuate(scene.air_energy_per_m(), scene.speed_of_sound_m_per_s());
  if (candidates.long_chains()) candidates.long_chains()->add_late(scene, listener, histogram);
  return stats;
}

TraceStats trace_late(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, EnergyHistogram& histogram) {
  return trace_late(scene, EarlyCandidates(scene, source), listener, histogram);
}

}  // namespace earshot
