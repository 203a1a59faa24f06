#include "sim/acoustics/path_tracer.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/sampling.h"
#include "sim/audio/ambisonics.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::uint32_t kRaysPerChunk = 256;   // unit of work and of the order of summation: part of the bits
constexpr std::uint32_t kChunksPerWave = 16;    // histograms held at once
/// Throughput, relative to a ray's start, below which Russian roulette begins: 40 dB down.  T30 looks at the decay to 35 dB, which is then
/// carried by as many rays as were started.  Measured in SHOE-1, a = 0.2, 64 rays, T30 rms error over 100 seeds: 22 % with 1e-1, 12 % with
/// 1e-2, 2.9 % with 1e-3, 1.9 % with 1e-4, at costs of 0.5, 0.8, 1.0 and 1.1 ms.
constexpr float kRouletteThreshold = 1e-4f;
/// Of the scene's diagonal: shortest distance in the geometry term.  Small, because scenes with 20 km of ground are legal.
constexpr float kLeastDistanceShare = 1e-5f;
constexpr float kPi = std::numbers::pi_v<float>;
constexpr int kMaxCoefficients = 36;
constexpr int kMaxChain = 4;

/// What all rays of one trace share.
struct Trace {
  const AcousticScene& scene;
  const EarlyCandidates& candidates;
  glm::vec3 source, listener;
  SphereSequence directions;
  std::uint32_t num_rays;
  int max_bounces, carried_order, sh_order, num_coefficients;
  float share_of_ray;          // 1 / num_rays
  float max_path_m, seconds_per_m;
  float least_distance2_m2;    // of the geometry term
  float source_radius_m;       // zero: no source volume
  bool diffuse_last_leg;
};

int num_bins(const AcousticConfig& config) {
  // A hair's breadth against 0.5f / 0.004f = 125.0000001.
  return static_cast<int>(std::ceil(double{config.rir_length_s} / config.time_bin_s * (1.0 - 1e-6)));
}

void write_harmonics(glm::vec3 direction, int order, std::span<float> sh) {
  if (order > 1) return spherical_harmonics_n3d(direction, order, sh);
  sh[0] = 1.f;
  if (order == 0) return;
  // Ambisonic axes (x, y, z) = (-z, -x, y) of the world; ACN order W, Y, Z, X.
  const float root3 = std::numbers::sqrt3_v<float>;
  sh[1] = -root3 * direction.x;
  sh[2] = root3 * direction.y;
  sh[3] = -root3 * direction.z;
}

/// Radius of the source volume: as configured, or less where a surface is nearer.
float free_radius_m(const AcousticScene& scene, glm::vec3 source) {
  constexpr std::uint32_t probes = 64;
  const SphereSequence directions(0x80000000u, 0x80000000u);
  float nearest_m = std::numeric_limits<float>::infinity();
  for (std::uint32_t i = 0; i < probes; ++i) {
    nearest_m = std::min(nearest_m, scene.scene().rays().intersect(source, directions.direction(i)).distance_m);
  }
  return std::min(scene.config().source_radius_m, 0.9f * nearest_m);
}

/// One listener ray in flight.  W: bands rounded up to whole vectors; lanes past the last band stay zero.
template <int W>
struct alignas(32) RayState {
  float throughput[W], reflected[W], arriving[W];
  /// Probability density of the path so far in each band, divided by its mean over bands.  Lobes are picked with the mean probability, so
  /// this is the balance heuristic over bands (hero wavelengths, Wilkie et al. 2014): it never exceeds the number of bands, where
  /// independent picks by the plain mean would let the weight of a band grow exponentially with the bounces.
  float weight[W];
  std::array<float, kMaxCoefficients> sh;
  std::array<std::uint32_t, kMaxChain> chain;  // planes of a purely specular path, listener first
  int chain_length = 0;
  bool all_specular = true, after_mirror = false;
  float path_m = 0;
};

/// Do image paths carry this specular chain?  The last plane is `plane` if it is given, else the end of the chain.
template <int W>
bool carried(const Trace& trace, const RayState<W>& ray, const std::uint32_t* plane) {
  const int length = ray.chain_length + (plane ? 1 : 0);
  if (!ray.all_specular || length == 0 || length > trace.carried_order) return false;
  std::array<std::uint32_t, kMaxChain> from_source;  // candidates count from the source
  int i = 0;
  if (plane) from_source[i++] = *plane;
  for (int j = ray.chain_length - 1; j >= 0; --j) from_source[i++] = ray.chain[j];
  return trace.candidates.contains(std::span(from_source.data(), static_cast<std::size_t>(length)));
}

/// Adds ray.arriving at path length `path_m`; NaN and infinity stop here and are counted.
template <int W>
void deposit(const Trace& trace, RayState<W>& ray, float path_m, EnergyHistogram& histogram) {
  histogram.add(path_m * trace.seconds_per_m, std::span(ray.arriving, static_cast<std::size_t>(trace.scene.num_bands())),
                std::span(ray.sh.data(), static_cast<std::size_t>(trace.num_coefficients)));
}

/// Combines the lanes as a tree: eight at a time, then halves.  A running sum would cost W dependent additions.
template <int W, class Combine>
float reduce(const float (&values)[W], Combine combine) {
  float part[8];
  for (int b = 0; b < 8; ++b) part[b] = values[b];
  for (int block = 8; block < W; block += 8) {
    for (int b = 0; b < 8; ++b) part[b] = combine(part[b], values[block + b]);
  }
  for (int b = 0; b < 4; ++b) part[b] = combine(part[b], part[b + 4]);
  return combine(combine(part[0], part[2]), combine(part[1], part[3]));
}
template <int W>
float sum_of(const float (&values)[W]) {
  return reduce(values, [](float a, float b) { return a + b; });
}

/// Track-length estimate of a segment that left a mirror: chord / (4 pi volume) of the source sphere.
template <int W>
void cross_source_volume(const Trace& trace, RayState<W>& ray, glm::vec3 origin, glm::vec3 direction, float segment_m,
                         EnergyHistogram& histogram, TraceStats& stats) {
  const glm::vec3 to_source = trace.source - origin;
  const float along_m = glm::dot(to_source, direction);
  const float radius2 = trace.source_radius_m * trace.source_radius_m;
  const glm::vec3 miss = to_source - along_m * direction;
  const float half2 = radius2 - glm::dot(miss, miss);
  if (!(half2 > 0)) return;
  const float half_m = std::sqrt(half2);
  const float enter_m = std::max(along_m - half_m, 0.f), leave_m = std::min(along_m + half_m, segment_m);
  if (!(leave_m > enter_m) || carried<W>(trace, ray, nullptr)) return;
  const float volume_m3 = 4.f / 3.f * kPi * radius2 * trace.source_radius_m;
  const float factor = trace.share_of_ray * (leave_m - enter_m) / (4.f * kPi * volume_m3);
  for (int b = 0; b < W; ++b) ray.arriving[b] = ray.throughput[b] * factor;
  if (!std::isfinite(sum_of(ray.arriving))) {
    ++stats.nonfinite_dropped;
    return;
  }
  deposit(trace, ray, ray.path_m + 0.5f * (enter_m + leave_m), histogram);
}

/// Next-event estimation: d e = T f cos / (4 pi d^2) / (4 pi) with T starting at 4 pi / N and f = (1 - a) s / pi (ORACLES 2.1, O-11).
template <int W>
void connect_to_source(const Trace& trace, RayState<W>& ray, const Hit& hit, glm::vec3 start, const float* scattering,
                       EnergyHistogram& histogram, TraceStats& stats) {
  const glm::vec3 to_source = trace.source - start;
  const float distance2 = glm::dot(to_source, to_source);
  const float height_m = glm::dot(hit.normal, to_source);
  if (!(height_m > 0)) return;
  const float distance_m = std::sqrt(distance2);
  const float path_m = ray.path_m + distance_m;
  if (path_m > trace.max_path_m) return;
  const float cosine = height_m / distance_m;
  const float geometry = trace.share_of_ray * cosine / (4.f * kPi * kPi * std::max(distance2, trace.least_distance2_m2));
  const std::uint32_t plane = trace.scene.plane_of_triangle()[hit.triangle];
  if (trace.diffuse_last_leg && !carried(trace, ray, &plane)) {
    for (int b = 0; b < W; ++b) ray.arriving[b] = ray.reflected[b] * geometry;
  } else {
    for (int b = 0; b < W; ++b) ray.arriving[b] = ray.reflected[b] * scattering[b] * geometry;
  }
  const float total = sum_of(ray.arriving);
  if (!std::isfinite(total)) {
    ++stats.nonfinite_dropped;
    return;
  }
  if (!(total > 0)) return;
  ++stats.shadow_rays;
  if (trace.scene.scene().rays().occluded(start, trace.source)) return;
  deposit(trace, ray, path_m, histogram);
}

/// Picks diffuse or mirror and updates throughput and weight.  Returns true for diffuse.
template <int W>
bool pick_lobe(RayState<W>& ray, const float* scattering, int num_bands, float random) {
  alignas(32) float diffuse[W];
  for (int b = 0; b < W; ++b) diffuse[b] = ray.weight[b] * scattering[b];
  const float probability = std::min(sum_of(diffuse) / static_cast<float>(num_bands), 1.f);
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

/// Russian roulette (ORACLES 2.5).  False: the ray ends.
template <int W>
bool survive(RayState<W>& ray, float random) {
  const float largest = reduce(ray.throughput, [](float a, float b) { return a > b ? a : b; });
  if (largest >= kRouletteThreshold) return true;
  const float probability = largest / kRouletteThreshold;
  if (!(random < probability)) return false;
  const float scale = 1.f / probability;
  for (int b = 0; b < W; ++b) ray.throughput[b] *= scale;
  return true;
}

template <int W>
void trace_ray(const Trace& trace, std::uint32_t index, EnergyHistogram& histogram, TraceStats& stats) {
  const AcousticScene& scene = trace.scene;
  const EmbreeScene& rays = scene.scene().rays();
  const std::vector<std::uint32_t>& material_of_triangle = scene.scene().mesh().triangle_material;
  const RandomStream random(scene.config().seed, Purpose::scatter, index);

  RayState<W> ray;
  for (int b = 0; b < W; ++b) ray.throughput[b] = ray.weight[b] = b < scene.num_bands() ? 1.f : 0.f;
  glm::vec3 origin = trace.listener, direction = trace.directions.direction(index);
  // All that comes along this ray arrives from its first direction.
  write_harmonics(direction, trace.sh_order, ray.sh);

  for (int bounce = 0;; ++bounce) {
    const Hit hit = rays.intersect(origin, direction);
    ++(hit.valid() ? stats.ray_hits : stats.ray_escapes);
    if (ray.after_mirror && trace.source_radius_m > 0) {
      cross_source_volume(trace, ray, origin, direction, hit.distance_m, histogram, stats);
    }
    if (!hit.valid() || bounce == trace.max_bounces) return;
    ray.path_m += hit.distance_m;
    if (!(ray.path_m < trace.max_path_m)) return;

    const std::uint32_t material = material_of_triangle[hit.triangle];
    const float* reflectance = scene.padded_reflectance(material);
    const float* scattering = scene.padded_scattering(material);
    for (int b = 0; b < W; ++b) ray.reflected[b] = ray.throughput[b] * reflectance[b];
    origin = offset_from_surface(hit.position, hit.normal);
    connect_to_source(trace, ray, hit, origin, scattering, histogram, stats);

    const std::array<float, 4> u = random.uniform4(static_cast<std::uint32_t>(bounce));
    const bool diffuse = pick_lobe(ray, scattering, scene.num_bands(), u[2]);
    // The last bounce goes on only for the sake of the source volume behind a mirror.
    if (bounce + 1 == trace.max_bounces && (diffuse || trace.source_radius_m == 0)) return;
    if (!survive(ray, u[3])) return;
    if (diffuse) {
      ray.all_specular = false;
      direction = lambert_direction(hit.normal, u[0], u[1]);
    } else {
      if (ray.all_specular && ray.chain_length < kMaxChain) {
        ray.chain[ray.chain_length] = scene.plane_of_triangle()[hit.triangle];
      }
      ray.all_specular = ray.all_specular && ray.chain_length < kMaxChain;  // longer chains are never carried
      ray.chain_length += ray.all_specular ? 1 : 0;
      direction = mirror_direction(direction, hit.normal);
    }
    ray.after_mirror = !diffuse;
  }
}

using TraceRay = void (*)(const Trace&, std::uint32_t, EnergyHistogram&, TraceStats&);
constexpr TraceRay kTraceRay[] = {trace_ray<8>, trace_ray<16>, trace_ray<24>, trace_ray<32>};
static_assert(kMaxBands == 32);

void trace_chunk(const Trace& trace, std::uint32_t chunk, EnergyHistogram& histogram, TraceStats& stats) {
  const TraceRay trace_one = kTraceRay[trace.scene.padded_bands() / 8 - 1];
  const std::uint32_t first = chunk * kRaysPerChunk;
  const std::uint32_t count = std::min(kRaysPerChunk, trace.num_rays - first);
  for (std::uint32_t i = 0; i < count; ++i) trace_one(trace, first + i, histogram, stats);
}

void add(TraceStats& total, const TraceStats& part) {
  total.ray_hits += part.ray_hits;
  total.ray_escapes += part.ray_escapes;
  total.shadow_rays += part.shadow_rays;
  total.nonfinite_dropped += part.nonfinite_dropped;
}

/// Chunks in waves; chunk histograms are summed in double and in the order of the chunks, so threads cannot change a bit.
void trace_chunks(const Trace& trace, std::uint32_t num_chunks, EnergyHistogram& histogram, TraceStats& stats) {
  const int threads = trace.scene.config().threads;
  const std::uint32_t wave_size = std::min(num_chunks, threads == 1 ? 1u : kChunksPerWave);
  std::vector<EnergyHistogram> parts(wave_size, make_histogram(trace.scene));
  std::vector<TraceStats> part_stats(wave_size);
  std::vector<double> sum(histogram.values().size(), 0.0);
  double dropped = 0;
  const int available = tbb::this_task_arena::max_concurrency();
  tbb::task_arena arena(threads == 0 ? available : std::min(threads, available));

  for (std::uint32_t first = 0; first < num_chunks; first += wave_size) {
    const std::uint32_t count = std::min(wave_size, num_chunks - first);
    const auto run = [&](std::uint32_t i) {
      parts[i].clear();
      part_stats[i] = {};
      trace_chunk(trace, first + i, parts[i], part_stats[i]);
    };
    if (threads == 1) {
      for (std::uint32_t i = 0; i < count; ++i) run(i);
    } else {
      arena.execute([&] { tbb::parallel_for(0u, count, run); });
    }
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::span<const float> values = parts[i].values();
      for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += values[k];
      dropped += parts[i].dropped_energy();
      add(stats, part_stats[i]);
    }
  }
  std::transform(sum.begin(), sum.end(), histogram.values().begin(), [](double value) { return static_cast<float>(value); });
  histogram.add_dropped(dropped);
}

}  // namespace

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

TraceStats trace_late(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyHistogram& histogram) {
  const AcousticConfig& config = scene.config();
  histogram.clear();
  TraceStats stats;
  const auto num_rays = static_cast<std::uint32_t>(config.rays);
  if (config.late == Switch::off || num_rays == 0 || config.max_bounces == 0) return stats;
  stats.rays = num_rays;

  const auto shift = RandomStream(config.seed, Purpose::listener_ray).bits4(0);
  const float least_distance_m = kLeastDistanceShare * scene.diagonal_m();
  const Trace trace{.scene = scene,
                    .candidates = candidates,
                    .source = candidates.source(),
                    .listener = listener,
                    .directions = {shift[0], shift[1]},
                    .num_rays = num_rays,
                    .max_bounces = config.max_bounces,
                    .carried_order = config.early == Switch::off ? 0 : config.early_order,
                    .sh_order = config.sh_order,
                    .num_coefficients = histogram.num_coefficients(),
                    .share_of_ray = 1.f / static_cast<float>(num_rays),
                    .max_path_m = scene.max_path_m(),
                    .seconds_per_m = 1.f / scene.speed_of_sound_m_per_s(),
                    .least_distance2_m2 = least_distance_m * least_distance_m,
                    .source_radius_m = config.diffuse_last_leg ? 0.f : free_radius_m(scene, candidates.source()),
                    .diffuse_last_leg = config.diffuse_last_leg};
  const std::uint32_t num_chunks = (num_rays + kRaysPerChunk - 1) / kRaysPerChunk;
  if (num_chunks == 1) {
    trace_chunk(trace, 0, histogram, stats);
  } else {
    trace_chunks(trace, num_chunks, histogram, stats);
  }
  histogram.attenuate(scene.air_energy_per_m(), scene.speed_of_sound_m_per_s());
  return stats;
}

TraceStats trace_late(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, EnergyHistogram& histogram) {
  return trace_late(scene, EarlyCandidates(scene, source), listener, histogram);
}

}  // namespace earshot
