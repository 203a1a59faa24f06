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

/// Ray number i as it leaves the listener.
template <int W>
void start_ray(const Trace& trace, std::uint32_t i, RayState<W>& ray) {
  for (int b = 0; b < W; ++b) ray.throughput[b] = ray.weight[b] = b < trace.scene.num_bands() ? 1.f : 0.f;
  ray.only_walls = trace.walls != nullptr;
  ray.first = i;
  ray.origin = trace.listener;
  ray.direction = trace.directions.direction(i);
  // All that comes along this ray arrives from its first direction.
  spherical_harmonics_n3d(ray.direction, trace.sh_order, ray.sh);
}

/// Does sound reach some rooms of the scene through walls alone?
bool has_rooms_behind_walls(const EffectPlan& plan) {
  return std::ranges::any_of(plan.decisions, [](const EffectDecision& decision) {
    return decision.effect == "transmission_late" && decision.on && std::isinf(decision.change);
  });
}

/// Rays of a chunk that have gone through a wall, where sound reaches rooms through walls alone.
///
/// Most energy that reaches a listener behind a wall may have been in the room of the source for long.  Of rays that pick the wall by
/// chance one in twenty gets there at a transmittance of 0.05.  So each ray that has been through no wall is parted at walls (importance
/// splitting, Kahn and Harris 1951), and those that went through are weighed against each other alone (control_group): as many as those
/// that stayed.  No mean changes.
template <int W>
class RaysBehindWalls {
 public:
  static constexpr std::uint32_t kSlots = 0x80000000u;  ///< their random numbers are those of slots from here on
  static constexpr std::uint32_t kMost = 8;             ///< times the rays of the chunk; all others go by chance

  RaysBehindWalls(const Trace& trace, std::size_t count)
      : trace_(trace), count_(count), on_(trace.walls != nullptr && has_rooms_behind_walls(trace.scene.plan())) {}

  /// What a ray of the first group does at a wall: as `part` of listener_ray::advance.
  bool part(RayState<W>& ray, std::uint32_t material) {
    if (!on_ || !trace_.walls->transmits(material) || rays_.size() >= kMost * count_) return false;
    RayState<W> through = listener_ray::part_at_wall<W>(trace_, ray, material);
    const float total = sum_over_bands<W>(through.throughput);
    if (total > 0 && std::isfinite(total)) rays_.push_back(through);
    return true;
  }
  std::vector<RayState<W>>& rays() { return rays_; }

  /// random: uniform in [0, 1).  Returns how many were ended because their energy was not finite.
  int control(double random) {
    int nonfinite = 0;
    std::erase_if(rays_, [&](const RayState<W>& ray) {
      if (!ray.alive) return true;
      const bool bad = !std::isfinite(sum_over_bands<W>(ray.reflected));
      nonfinite += bad ? 1 : 0;
      return bad;
    });
    if (!rays_.empty()) control_group<W>(trace_.scene.num_bands(), rays_, static_cast<double>(count_), peak_, random);
    return nonfinite;
  }

 private:
  const Trace& trace_;
  std::size_t count_;
  bool on_;
  std::vector<RayState<W>> rays_;
  double peak_ = 0;
};

/// paths: records the vertices; may be null.
template <int W>
void trace_chunk(const Trace& trace, std::uint32_t chunk, ListenerPaths* paths, EnergyHistogram& histogram, TraceStats& stats) {
  const std::uint64_t seed = trace.scene.config().seed;
  const std::uint32_t first = chunk * kRaysPerChunk;
  std::array<RayState<W>, kRaysPerChunk> storage;
  const auto rays = std::span(storage).first(std::min(kRaysPerChunk, trace.num_rays - first));
  for (std::uint32_t i = 0; i < rays.size(); ++i) start_ray<W>(trace, first + i, rays[i]);
  RaysBehindWalls<W> behind(trace, rays.size());
  WallRoulette<W> roulette;
  std::uint64_t of_connections = 0;  // of what was not finite
  for (std::uint32_t stage = 0;; ++stage) {
    const float until_m = static_cast<float>(stage + 1) * trace.stage_m;
    bool any_alive = false;
    const auto follow = [&](RayState<W>& ray, std::uint32_t slot, const auto& part) {
      if (!ray.alive) return;
      // A slot draws new numbers in each stage, whichever ray it holds.
      const RandomStream random(seed, Purpose::scatter, slot, stage);
      const auto visit = [&] {
        if (paths != nullptr) record_vertex(ray, slot, stage, *paths);
        const std::uint64_t before = stats.nonfinite_dropped;
        connect_vertex(trace, ray, random, roulette, {histogram, stats});
        of_connections += stats.nonfinite_dropped - before;
      };
      advance(trace, ray, until_m, random, visit, part, {histogram, stats});
      any_alive = any_alive || ray.alive;
    };
    for (std::uint32_t i = 0; i < rays.size(); ++i)
      follow(rays[i], first + i, [&](std::uint32_t material) { return behind.part(rays[i], material); });
    // Those that went through in this stage are among them; their slots are those of chunks of kMost times as many rays.
    for (std::uint32_t i = 0; i < behind.rays().size(); ++i)
      follow(behind.rays()[i], RaysBehindWalls<W>::kSlots + RaysBehindWalls<W>::kMost * first + i, [](std::uint32_t) { return false; });
    if (!any_alive) break;
    stats.nonfinite_dropped += static_cast<std::uint64_t>(
        control_population<W>(trace.scene.num_bands(), rays, RandomStream(seed, Purpose::roulette, chunk, stage).uniform(0)));
    stats.nonfinite_dropped += static_cast<std::uint64_t>(behind.control(RandomStream(seed, Purpose::roulette, chunk, stage).uniform(1)));
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
