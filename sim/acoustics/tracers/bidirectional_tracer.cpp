// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/bidirectional_tracer.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "sim/acoustics/core/histogram_sum.h"
#include "sim/acoustics/tracers/listener_subpath.h"
#include "sim/acoustics/tracers/population_control.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::uint32_t kBatches = 16;
constexpr double kMinConnected = 0.25;                      // of listener vertices
constexpr std::size_t kWaveBytes = std::size_t{256} << 20;  // of batch histograms held at once

/// Counts finished units of work and reports the fraction that is done, one call at a time.
class ProgressReport {
 public:
  ProgressReport(const std::function<void(double)>& report, std::uint64_t total) : report_(report), total_(total) {}
  void finish(std::uint64_t units) {
    if (!report_) return;
    const std::lock_guard lock(mutex_);
    done_ += units;
    report_(static_cast<double>(done_) / static_cast<double>(total_));
  }

 private:
  const std::function<void(double)>& report_;
  std::mutex mutex_;
  std::uint64_t done_ = 0, total_;
};

/// State of one batch.
struct Batch {
  std::uint32_t index = 0, num_rays = 0, num_source_paths = 0;
  std::uint32_t count = 1;  // of batches
};

template <int W>
class BatchTracer {
 public:
  BatchTracer(const BidirectionalScene& shared, Batch batch, EnergyHistogram& result, std::span<float> unseen, TraceStats& stats,
              ProgressReport& progress)
      : shared_(shared),
        batch_(batch),
        result_(result),
        part_(make_histogram(shared.scene)),
        unseen_(unseen),
        stats_(stats),
        progress_(progress) {}

  void run() {
    HistogramSum sum(result_);
    trace_sources(sum);
    std::vector<ListenerRay<W>> rays;
    for (std::uint32_t first = 0; first < batch_.num_rays; first += kRaysPerChunk) {
      const std::uint32_t count = std::min(kRaysPerChunk, batch_.num_rays - first);
      part_.clear();
      rays.assign(count, {});
      trace_rays(first, rays);
      sum.add(part_);
      progress_.finish(count);
    }
    sum.write(result_);
  }

 private:
  [[nodiscard]] BatchOutput<W> output(std::uint32_t num_paths) {
    return {.histogram = part_,
            .stats = stats_,
            .seconds_per_m = shared_.seconds_per_m,
            .num_bands = static_cast<std::size_t>(shared_.scene.num_bands()),
            .num_coefficients = static_cast<std::size_t>(shared_.num_coefficients),
            .unseen = unseen_,
            .batches = static_cast<float>(batch_.count),
            .path_weight = 1.f / static_cast<float>(num_paths)};
  }
  [[nodiscard]] SphereSequence directions(Purpose purpose) const {
    const auto shift = RandomStream(shared_.seed, purpose, 0xFFFFFFFFu, 0, batch_.index + 1).bits4(0);
    return {shift[0], shift[1]};
  }

  /// Keeps the source's paths, and adds what connects them to the listener to `sum`, by blocks that float can add.
  void trace_sources(HistogramSum& sum) {
    const auto num_events = static_cast<std::uint32_t>(shared_.strategies.source_bounces);
    vertices_.assign(std::size_t{batch_.num_source_paths} * num_events, {});
    sources_ = {.vertices = vertices_, .num_paths = batch_.num_source_paths, .num_events = num_events};
    if (vertices_.empty()) return;
    const SphereSequence sequence = directions(Purpose::source_ray);
    BatchOutput<W> out = output(batch_.num_source_paths);
    for (std::uint32_t path = 0; path < batch_.num_source_paths; ++path) {
      const auto vertices = std::span(vertices_).subspan(std::size_t{path} * num_events, num_events);
      trace_source_subpath<W>(shared_, sequence.direction(path), RandomStream(shared_.seed, Purpose::source_ray, path, 0, batch_.index + 1),
                              vertices, stats_);
      if (!(shared_.strategies.to_listener > 0)) continue;
      for (const SourceVertex<W>& vertex : vertices) connect_to_listener(shared_, vertex, out);
      if ((path + 1) % kRaysPerChunk != 0 && path + 1 != batch_.num_source_paths) continue;
      sum.add(part_);
      part_.clear();
    }
  }

  /// Rays `first` and following, under population control (population_control.h).
  void trace_rays(std::uint32_t first, std::span<ListenerRay<W>> rays) {
    const SphereSequence sequence = directions(Purpose::listener_ray);
    for (std::uint32_t i = 0; i < rays.size(); ++i) start_ray(shared_, sequence.direction(first + i), rays[i]);
    BatchOutput<W> out = output(batch_.num_rays);
    for (std::uint32_t stage = 0;; ++stage) {
      const float until_m = static_cast<float>(stage + 1) * shared_.stage_m;
      bool any_alive = false;
      for (std::uint32_t i = 0; i < rays.size(); ++i) {
        if (!rays[i].alive) continue;
        // A slot draws new numbers in each stage, whichever ray it holds.
        const RandomStream random(shared_.seed, Purpose::scatter, first + i, stage, batch_.index + 1);
        advance(shared_, sources_, {first + i, until_m, random}, rays[i], out);
        any_alive = any_alive || rays[i].alive;
      }
      if (!any_alive) return;
      stats_.nonfinite_dropped += static_cast<std::uint64_t>(
          control_population<W>(shared_.scene.num_bands(), rays,
                                RandomStream(shared_.seed, Purpose::roulette, first / kRaysPerChunk, stage, batch_.index + 1).uniform(0)));
    }
  }

  const BidirectionalScene& shared_;
  Batch batch_;
  EnergyHistogram& result_;
  EnergyHistogram part_;
  std::span<float> unseen_;
  TraceStats& stats_;
  ProgressReport& progress_;
  std::vector<SourceVertex<W>> vertices_;
  SourceSubpaths<W> sources_;
};

template <int W>
void trace_batch(const BidirectionalScene& shared, Batch batch, EnergyHistogram& result, std::span<float> unseen, TraceStats& stats,
                 ProgressReport& progress) {
  BatchTracer<W>(shared, batch, result, unseen, stats, progress).run();
}

void trace_batch(const BidirectionalScene& shared, Batch batch, EnergyHistogram& result, std::span<float> unseen, TraceStats& stats,
                 ProgressReport& progress) {
  using TraceBatch = void (*)(const BidirectionalScene&, Batch, EnergyHistogram&, std::span<float>, TraceStats&, ProgressReport&);
  constexpr TraceBatch by_width[] = {trace_batch<8>, trace_batch<16>, trace_batch<24>, trace_batch<32>};
  static_assert(kMaxBands == 32);
  by_width[shared.scene.padded_bands() / 8 - 1](shared, batch, result, unseen, stats, progress);
}

/// Rays and paths of each batch; the first ones get what is left over.
std::vector<Batch> deal_batches(std::uint32_t num_rays, std::uint32_t num_source_paths) {
  const std::uint32_t count = std::min(num_rays, kBatches);
  std::vector<Batch> batches(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto part = [&](std::uint32_t all) { return all / count + (i < all % count ? 1u : 0u); };
    // With fewer paths than batches each batch still needs one: its estimate stands alone.
    batches[i] = {i, part(num_rays), num_source_paths == 0 ? 0u : std::max(part(num_source_paths), 1u), count};
  }
  return batches;
}

/// volume_radius_m: of the sphere that catches what no strategy connects; 0 if there is none.
mis::Strategies strategies_of(const AcousticConfig& config, const BidirectionalOptions& options, const Batch& batch,
                              float volume_radius_m) {
  mis::Strategies strategies{.next_event = options.next_event ? 1.0 : 0.0};
  if (batch.num_source_paths == 0) return strategies;
  // As many connected listener rays as source paths: the others serve paths with a mirror at both ends, which only the volume catches, and
  // are spared two shadow rays of three rays per vertex.
  strategies.connected = std::clamp(double{1} * config.source_rays / config.rays, kMinConnected, 1.0);
  strategies.next_event *= strategies.connected;
  strategies.source_bounces = std::min(config.source_bounces, config.max_bounces);
  if (options.connection) strategies.connection = strategies.connected / strategies.source_bounces;
  // A catch in the volume weighs 1 / (4 pi^2 r^2) in the mean: a connection over a shorter edge than r can weigh more.  Paths with no other
  // open edge are then left to the volume; without next-event estimation some of them would be lost, as the volume only sees mirrors.
  if (options.next_event && !options.short_edges) strategies.least_edge_m = volume_radius_m;
  if (options.to_listener) strategies.to_listener = static_cast<double>(batch.num_source_paths) / batch.num_rays;
  return strategies;
}

void keep_energy(const EnergyHistogram& histogram, std::uint32_t batch, LateBatches& batches) {
  const std::size_t size = static_cast<std::size_t>(batches.num_bins) * batches.num_bands;
  float* to = &batches.energy[batch * size];
  for (int bin = 0; bin < batches.num_bins; ++bin) {
    for (int band = 0; band < batches.num_bands; ++band) *to++ = histogram.energy(bin, band);
  }
}

/// Air, as EnergyHistogram::attenuate applies it.
void attenuate(const AcousticScene& scene, float bin_s, std::span<float> unseen) {
  const auto num_bands = static_cast<std::size_t>(scene.num_bands());
  for (std::size_t i = 0; i < unseen.size(); ++i) {
    const float path_m = (static_cast<float>(i / num_bands) + 0.5f) * bin_s * scene.speed_of_sound_m_per_s();
    unseen[i] *= std::exp(-scene.air_energy_per_m()[i % num_bands] * path_m);
  }
}

/// Constants of all batches; each batch sets `strategies`.
BidirectionalScene shared_by_batches(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                                     int num_coefficients) {
  const AcousticConfig& config = scene.config();
  const float source_radius_m = candidates.sound_source().radius_m;
  const float least_distance_m = kMinDistanceFraction * scene.diagonal_m();
  return {.scene = scene,
          .candidates = candidates,
          .model = scene.reflection_model(),
          .emission = candidates.emission().omnidirectional() ? nullptr : &candidates.emission(),
          .source = candidates.source(),
          .listener = listener,
          .source_radius_m = source_radius_m,
          .volume_radius_m = source_radius_m > 0.f ? source_radius_m : free_radius_m(scene, candidates.source()),
          .strategies = {},
          .max_bounces = config.max_bounces,
          .carried_order = scene.image_order(),
          .sh_order = config.sh_order,
          .num_coefficients = num_coefficients,
          .max_path_m = scene.max_path_m(),
          .seconds_per_m = 1.f / scene.speed_of_sound_m_per_s(),
          .stage_m = std::max(kStageOfDiagonal * scene.diagonal_m(), 1e-4f * scene.max_path_m()),
          .least_distance2_m2 = least_distance_m * least_distance_m,
          .seed = config.seed};
}

LateBatches empty_batches(std::size_t count, const EnergyHistogram& shape) {
  LateBatches batches{
      .count = static_cast<int>(count), .num_bins = shape.num_bins(), .num_bands = shape.num_bands(), .energy = {}, .unseen = {}};
  const std::size_t size = static_cast<std::size_t>(shape.num_bins()) * static_cast<std::size_t>(shape.num_bands());
  batches.energy.resize(count * size);
  batches.unseen.resize(size);
  return batches;
}

/// Results of one batch of a wave.
struct BatchResult {
  EnergyHistogram late;
  std::vector<float> unseen;
  TraceStats stats;
};

/// images: of long chains, the same in every batch.  result: overwritten.
void trace_whole_batch(const BidirectionalScene& shared, const BidirectionalOptions& options, const Batch& batch,
                       const EnergyHistogram& images, BatchResult& result, ProgressReport& progress) {
  const FlushDenormals flush;
  const AcousticScene& scene = shared.scene;
  BidirectionalScene chunk_scene = shared;
  chunk_scene.strategies = strategies_of(scene.config(), options, batch, shared.volume_radius_m);
  result.stats = {};
  std::fill(result.unseen.begin(), result.unseen.end(), 0.f);
  trace_batch(chunk_scene, batch, result.late, result.unseen, result.stats, progress);
  result.late.attenuate(scene.air_energy_per_m(), scene.speed_of_sound_m_per_s());
  if (shared.candidates.long_chains()) result.late.add(images);
}

void keep_batch(const BatchResult& result, std::uint32_t batch, LateBatches& batches) {
  keep_energy(result.late, batch, batches);
  std::transform(result.unseen.begin(), result.unseen.end(), batches.unseen.begin(), batches.unseen.begin(),
                 [](float a, float b) { return std::max(a, b); });
}

}  // namespace

void LateBatches::scale(std::span<const float> factor) {
  const auto bands = static_cast<std::size_t>(num_bands);
  for (std::vector<float>* values : {&energy, &unseen})
    for (std::size_t i = 0; i < values->size(); ++i) (*values)[i] *= factor[i % bands];
}

TraceStats trace_bidirectional(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                               EnergyHistogram& histogram, LateBatches* batches, const BidirectionalOptions& options) {
  const FlushDenormals flush;
  const AcousticConfig& config = scene.config();
  histogram.clear();
  if (batches) batches->clear();
  TraceStats stats;
  if (config.late == Switch::off || config.rays == 0 || config.max_bounces == 0) return stats;
  stats.rays = static_cast<std::uint64_t>(config.rays);

  const std::vector<Batch> dealt = deal_batches(static_cast<std::uint32_t>(config.rays), static_cast<std::uint32_t>(config.source_rays));
  const BidirectionalScene shared = shared_by_batches(scene, candidates, listener, histogram.num_coefficients());
  if (batches) *batches = empty_batches(dealt.size(), histogram);
  EnergyHistogram images;
  if (candidates.long_chains()) {
    images = make_histogram(scene);
    candidates.long_chains()->add_late(scene, listener, images);
  }
  // Batches in waves, summed in double and in their order, so that threads cannot change a bit.
  const std::size_t bytes = std::max<std::size_t>(histogram.values().size() * sizeof(float), 1);
  const std::size_t wave = std::clamp<std::size_t>(kWaveBytes / bytes, 1, dealt.size());
  std::vector<BatchResult> results(wave, {make_histogram(scene), std::vector<float>(batches ? batches->unseen.size() : 0), {}});
  HistogramSum sum(histogram);
  ProgressReport progress(options.progress, stats.rays);
  const int available = tbb::this_task_arena::max_concurrency();
  tbb::task_arena arena(config.threads == 0 ? available : std::min(config.threads, available));
  for (std::size_t first = 0; first < dealt.size(); first += wave) {
    const std::size_t count = std::min(wave, dealt.size() - first);
    arena.execute([&] {
      tbb::parallel_for(std::size_t{0}, count,
                        [&](std::size_t i) { trace_whole_batch(shared, options, dealt[first + i], images, results[i], progress); });
    });
    for (std::size_t i = 0; i < count; ++i) {
      if (batches) keep_batch(results[i], dealt[first + i].index, *batches);
      sum.add(results[i].late, 1.0 / static_cast<double>(dealt.size()));
      stats.add(results[i].stats);
    }
  }
  sum.write(histogram);
  if (batches) attenuate(scene, histogram.bin_s(), batches->unseen);
  return stats;
}

}  // namespace earshot
