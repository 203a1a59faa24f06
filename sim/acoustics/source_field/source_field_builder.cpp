// SPDX-License-Identifier: Apache-2.0
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>

#include "sim/acoustics/geometry/field_smoothing.h"
#include "sim/acoustics/source_field/field_image.h"
#include "sim/acoustics/source_field/field_probes.h"
#include "sim/acoustics/source_field/photon_pass.h"
#include "sim/acoustics/source_field/smoothing_correction.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::uint32_t kChunksPerRound = FieldProbes::kBatches;  // photons come in whole rounds: a chunk for each batch
constexpr std::uint64_t kPhotonsPerRound = std::uint64_t{kChunksPerRound} * kPhotonsPerChunk;

/// Ten million segments through one bin of one cell, which 2^23 photons in a small room are, would lose a per cent in float.  So sums of
/// this many rounds go to sums in double; the few photons of `fast` never do, and pay for half the memory.
constexpr std::uint32_t kRoundsPerFold = 32;

/// Histories are larger than the caches near a core, and are visited in no order of memory: rows are prefetched this long before they are
/// used.  A segment crosses two or three cells.
constexpr std::size_t kFloatsPerLine = 16, kSegmentsAhead = 4, kCellsAhead = 8;

/// to[i] += factor * from[i]; count: a multiple of eight, whole vectors.
void add_scaled(const float* from, float factor, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; i += 8)
    for (std::size_t lane = 0; lane < 8; ++lane) to[i + lane] += factor * from[i + lane];
}

}  // namespace

struct SourceFieldBuilder::Impl {
  Impl(const AcousticScene& acoustic_scene, const EarlyCandidates& early_candidates)
      : Impl(acoustic_scene, early_candidates, make_histogram(acoustic_scene)) {}

  Impl(const AcousticScene& acoustic_scene, const EarlyCandidates& early_candidates, const EnergyHistogram& shape)
      : scene(acoustic_scene),
        candidates(early_candidates),
        grid(acoustic_scene.field_grid()),
        probes(acoustic_scene, early_candidates.source()),
        bins(field_bins(acoustic_scene, shape.num_bins())),
        num_bins(shape.num_bins()),
        num_coefficients(shape.num_coefficients()),
        bin_s(shape.bin_s()),
        history(grid.size()) {
    stride = static_cast<std::size_t>(acoustic_scene.padded_bands());
    row = static_cast<std::size_t>(num_coefficients) * stride;
  }

  /// Adds energy times length to merged bins of one cell.  In the fine part it is split between the two bins whose centres are nearest, as
  /// EnergyHistogram::add does, and behind the last centre of that part all goes to that bin.
  void add(std::uint32_t cell, float path_m, const float* weighted, float length_m) {
    const float position = path_m / (scene.speed_of_sound_m_per_s() * bin_s);
    if (!(position < static_cast<float>(num_bins) + 0.5f)) return;
    std::vector<float>& rows = history[cell];
    if (rows.empty()) rows.assign(bins.size() * row, 0.f);
    const std::size_t merged = bins.merged_bin_of(std::min(static_cast<std::size_t>(position), static_cast<std::size_t>(num_bins) - 1));
    const float from_centre = position - 0.5f;
    if (merged >= bins.fine() || from_centre <= 0 || from_centre >= static_cast<float>(bins.fine() - 1))
      return add_scaled(weighted, length_m, row, &rows[merged * row]);
    const float bin = std::floor(from_centre), to_next = from_centre - bin;
    float* bin_row = &rows[static_cast<std::size_t>(bin) * row];
    add_scaled(weighted, length_m * (1.f - to_next), row, bin_row);
    if (to_next > 0) add_scaled(weighted, length_m * to_next, row, bin_row + row);
  }

  /// Prefetches the memory that a segment's energy will be added to: its cells lie megabytes apart.
  void fetch(const PhotonTracks& of_chunk, const PhotonTracks::Segment& segment, std::uint32_t batch) const {
    const float bins_per_m = 1.f / (scene.speed_of_sound_m_per_s() * bin_s);
    for (std::uint32_t c = segment.first_crossing; c < segment.end_crossing; ++c) {
      const FieldGrid::Crossing& crossing = of_chunk.crossings[c];
      const float path_m = segment.path_m + 0.5f * (crossing.enter_m + crossing.leave_m), position = path_m * bins_per_m;
      if (history[crossing.cell].empty() || !(position < static_cast<float>(num_bins))) continue;
      // Of the fine bins it is split between two.
      const float from = std::max(position - 0.5f, 0.f);
      const bool fine = from < static_cast<float>(bins.fine() - 1);
      const std::size_t first = fine ? static_cast<std::size_t>(from) : bins.merged_bin_of(static_cast<std::size_t>(position));
      const float* row_begin = &history[crossing.cell][first * row];
      for (std::size_t i = 0; i < (fine ? 2 : 1) * row; i += kFloatsPerLine) __builtin_prefetch(row_begin + i, 1);
      probes.fetch(crossing.cell, path_m, batch);
    }
  }

  void add(const PhotonTracks& of_chunk, std::uint32_t batch) {
    std::array<float, kMaxCoefficients> sh{};
    std::array<float, kMaxCoefficients * kMaxBands> weighted{};
    for (std::size_t i = 0; i < of_chunk.segments.size(); ++i) {
      const PhotonTracks::Segment& segment = of_chunk.segments[i];
      if (i + kSegmentsAhead < of_chunk.segments.size()) fetch(of_chunk, of_chunk.segments[i + kSegmentsAhead], batch);
      const float* energy = &of_chunk.energy[i * stride];
      // The harmonics are those of where sound comes from.
      spherical_harmonics_n3d(-segment.direction, scene.config().sh_order, sh);
      for (int k = 0; k < num_coefficients; ++k)
        for (std::size_t b = 0; b < stride; ++b) weighted[static_cast<std::size_t>(k) * stride + b] = sh[k] * energy[b];
      for (std::uint32_t c = segment.first_crossing; c < segment.end_crossing; ++c) {
        const FieldGrid::Crossing& crossing = of_chunk.crossings[c];
        const float length_m = crossing.leave_m - crossing.enter_m;
        const float path_m = segment.path_m + 0.5f * (crossing.enter_m + crossing.leave_m);
        add(crossing.cell, path_m, weighted.data(), length_m);
        probes.add(crossing.cell, path_m, energy, length_m, batch);
        if (at_listener) at_listener->add(crossing.cell, path_m, energy, length_m, batch);
      }
    }
  }

  void trace_round() {
    std::array<TraceStats, kChunksPerRound> stats;
    const std::uint32_t first = rounds * kChunksPerRound;
    const int threads = scene.config().threads;
    if (threads == 1) {
      for (std::uint32_t i = 0; i < kChunksPerRound; ++i) {
        trace_photons(scene, candidates, grid, first + i, tracks[0], stats[i]);
        add(tracks[0], i);
      }
    } else {
      const int available = tbb::this_task_arena::max_concurrency();
      tbb::task_arena arena(threads == 0 ? available : std::min(threads, available));
      arena.execute([&] {
        tbb::parallel_for(0u, kChunksPerRound, [&](std::uint32_t i) {
          const FlushDenormals flush;
          trace_photons(scene, candidates, grid, first + i, tracks[i], stats[i]);
        });
      });
      for (std::uint32_t i = 0; i < kChunksPerRound; ++i) add(tracks[i], i);
    }
    for (const TraceStats& of_chunk : stats) nonfinite_dropped += of_chunk.nonfinite_dropped;
    if (++rounds % kRoundsPerFold == 0) fold();
  }

  /// Moves the sums in float to those in double.
  void fold() {
    folded.resize(history.size());
    for (std::size_t cell = 0; cell < history.size(); ++cell) {
      if (history[cell].empty()) continue;
      folded[cell].resize(history[cell].size(), 0.0);
      std::transform(folded[cell].begin(), folded[cell].end(), history[cell].begin(), folded[cell].begin(),
                     [](double sum, float part) { return sum + double{part}; });
      std::fill(history[cell].begin(), history[cell].end(), 0.f);
    }
  }

  [[nodiscard]] std::uint64_t photons() const { return rounds * kPhotonsPerRound; }

  /// Air once, here: path length is c t (docs/explanation/effect_bounds.md, section 2).  factor: [padded bands], energy after air
  /// absorption in this merged bin.
  void air_at(std::size_t merged, std::span<double> factor) const {
    const double path_m = bins.middle(merged) * bin_s * scene.speed_of_sound_m_per_s();
    std::fill(factor.begin(), factor.end(), 0.0);
    for (int band = 0; band < scene.num_bands(); ++band)
      factor[static_cast<std::size_t>(band)] = std::exp(-double{scene.air_energy_per_m()[band]} * path_m);
  }

  /// Energy of a cell in a merged bin as photons left it, first coefficient.
  bool raw_energy(std::uint32_t cell, std::size_t merged, std::span<float> energy) const {
    if (history[cell].empty()) return false;
    const std::size_t at = merged * row;
    std::copy_n(&history[cell][at], stride, energy.begin());
    if (!folded.empty() && !folded[cell].empty())
      for (std::size_t b = 0; b < stride; ++b) energy[b] = static_cast<float>(folded[cell][at + b] + double{energy[b]});
    return true;
  }

  [[nodiscard]] SmoothingCorrection correction_of(const std::vector<std::uint32_t>& active) const {
    std::vector<int> sweeps(bins.size());
    for (std::size_t merged = 0; merged < bins.size(); ++merged) sweeps[merged] = probes.sweeps_at(bins.middle(merged) * bin_s);
    return {scene.field_smoothing(),
            bins,
            sweeps,
            history.size(),
            active,
            stride,
            [this](std::uint32_t cell, std::size_t merged, std::span<float> energy) { return raw_energy(cell, merged, energy); }};
  }

  /// Cells as the image holds them: late merged bins smoothed, air and units applied.
  struct CellImage {
    std::uint32_t first = 0;         ///< merged bin
    std::vector<FieldValue> values;  ///< [merged bins from first][coefficients][padded bands]
  };
  struct FieldImage {
    std::vector<CellImage> cells;
    double blur = 0;  ///< FieldProbes::t20_blur
  };
  /// What has come to the listener.  spread: factor of how much batches differ.
  [[nodiscard]] FieldBatches batches(double spread) const {
    const auto bands = static_cast<std::size_t>(scene.num_bands()), count = static_cast<std::size_t>(num_bins);
    FieldBatches result;
    result.count = FieldProbes::kBatches;
    result.share.assign(FieldProbes::kBatches * count * bands, 1.f);
    std::vector<float> energy;
    at_listener->read(0, energy);
    std::array<double, FieldProbes::kBatches> of_batch{};
    for (std::size_t merged = 0; merged < bins.size(); ++merged)
      for (std::size_t band = 0; band < bands; ++band) {
        double whole = 0;
        for (std::uint32_t i = 0; i < FieldProbes::kBatches; ++i) {
          of_batch[i] = 0;
          for (std::size_t bin = bins.first_bin(merged); bin < bins.first_bin(merged + 1); ++bin)
            of_batch[i] += double{energy[(i * count + bin) * stride + band]};
          whole += of_batch[i] / FieldProbes::kBatches;
        }
        if (!(whole > 0)) continue;
        for (std::uint32_t i = 0; i < FieldProbes::kBatches; ++i)
          for (std::size_t bin = bins.first_bin(merged); bin < bins.first_bin(merged + 1); ++bin)
            result.share[(i * count + bin) * bands + band] = static_cast<float>(1 + spread * (of_batch[i] / whole - 1));
      }
    return result;
  }

  [[nodiscard]] FieldImage finish() const {
    const FieldSmoothing& smoothing = scene.field_smoothing();
    FieldImage image{.cells = std::vector<CellImage>(history.size())};
    std::vector<bool> lit(history.size());
    for (std::size_t cell = 0; cell < history.size(); ++cell) lit[cell] = !history[cell].empty();
    const std::vector<std::uint32_t> active = smoothing.reachable(lit);
    // Fluence is track length per volume; the energy of the Green's function is that over 4 pi (docs/evidence/oracles.md, O-11).
    const double per_photon = 1.0 / (4.0 * std::numbers::pi * static_cast<double>(std::max<std::uint64_t>(photons(), 1)));
    std::vector<float> rows(history.size() * row, 0.f), spare;
    std::array<double, kMaxBands> air{};
    std::array<float, kMaxBands> factor{};
    const SmoothingCorrection correction = correction_of(active);
    image.blur = probes.t20_blur(correction, bins);
    // Bin by bin: all cells of one stay in the second cache.
    for (std::size_t merged = 0; merged < bins.size(); ++merged) {
      bool has_energy = false;
      for (std::size_t rank = 0; rank < active.size(); ++rank) {
        const std::uint32_t cell = active[rank];
        if (rank + kCellsAhead < active.size()) {
          const std::vector<float>& next = history[active[rank + kCellsAhead]];
          for (std::size_t at = 0; at < row && !next.empty(); at += kFloatsPerLine) __builtin_prefetch(&next[merged * row + at]);
        }
        float* to = &rows[cell * row];
        if (history[cell].empty()) {
          std::fill_n(to, row, 0.f);
        } else {
          std::copy_n(&history[cell][merged * row], row, to);
          if (!folded.empty() && !folded[cell].empty()) {
            const double* sum = &folded[cell][merged * row];
            for (std::size_t i = 0; i < row; ++i) to[i] = static_cast<float>(sum[i] + double{to[i]});
          }
          has_energy = has_energy || std::any_of(to, to + stride, [](float value) { return value != 0.f; });
        }
      }
      if (!has_energy) continue;
      smoothing.sweep(probes.sweeps_at(bins.middle(merged) * bin_s), row, active, rows, spare);
      air_at(merged, air);
      for (const std::uint32_t cell : active) {
        const float* from = &rows[cell * row];
        // The first coefficient is the energy itself: where it is zero, the others are.
        if (std::all_of(from, from + stride, [](float value) { return value == 0.f; })) continue;
        CellImage& out = image.cells[cell];
        if (out.values.empty()) {
          out.first = static_cast<std::uint32_t>(merged);
          out.values.reserve((bins.size() - merged) * row);
        }
        out.values.resize((merged - out.first + 1) * row, 0);
        const double scale = per_photon / double{grid.volume_m3(cell)};
        correction.factors(cell, merged, factor);
        for (std::size_t b = 0; b < stride; ++b) factor[b] *= static_cast<float>(scale * air[b]);
        FieldValue* to = &out.values[(merged - out.first) * row];
        for (std::size_t k = 0; k < row; k += stride)
          for (std::size_t b = 0; b < stride; ++b) to[k + b] = to_field_value(from[k + b] * factor[b]);
      }
    }
    return image;
  }

  const AcousticScene& scene;
  const EarlyCandidates& candidates;
  const FieldGrid& grid;
  FieldProbes probes;
  std::optional<FieldProbes> at_listener;  ///< for batches()
  WideningBins bins;
  int num_bins, num_coefficients;
  float bin_s;
  std::size_t stride = 0, row = 0;          ///< padded bands; times coefficients
  std::vector<std::vector<float>> history;  ///< [cells][merged bins][coefficients][padded bands]; empty where no photon came
  std::vector<std::vector<double>> folded;  ///< the same, of the rounds before the last fold; empty before the first
  std::array<PhotonTracks, kChunksPerRound> tracks;
  std::uint32_t rounds = 0;
  std::uint64_t nonfinite_dropped = 0;
  double t20_error = 1;
};

SourceFieldBuilder::SourceFieldBuilder(const AcousticScene& scene, const EarlyCandidates& candidates)
    : impl_(std::make_unique<Impl>(scene, candidates)) {}
SourceFieldBuilder::~SourceFieldBuilder() = default;
SourceFieldBuilder::SourceFieldBuilder(SourceFieldBuilder&&) noexcept = default;

bool SourceFieldBuilder::refine() {
  const FlushDenormals flush;
  Impl& acoustic_scene = *impl_;
  const AcousticConfig& config = acoustic_scene.scene.config();
  const auto most =
      static_cast<std::uint32_t>(std::max<std::uint64_t>(static_cast<std::uint64_t>(config.field_photons) / kPhotonsPerRound, 1));
  if (acoustic_scene.rounds >= most || (acoustic_scene.rounds > 0 && acoustic_scene.t20_error <= double{config.field_error})) return false;
  std::uint32_t add = 1;
  if (acoustic_scene.rounds > 0) {
    // The error falls as the root of the photons: as many as that needs, but between an eighth more and four times as many.
    const double ratio = acoustic_scene.t20_error / config.field_error;
    const double wanted = acoustic_scene.rounds * std::clamp(ratio * ratio, 1.125, 4.0);
    add = std::max(1u, static_cast<std::uint32_t>(std::ceil(wanted)) - acoustic_scene.rounds);
  }
  for (const std::uint32_t end = std::min(acoustic_scene.rounds + add, most); acoustic_scene.rounds < end;) acoustic_scene.trace_round();
  acoustic_scene.t20_error = acoustic_scene.probes.t20_error();
  return true;
}

double SourceFieldBuilder::t20_error() const { return impl_->t20_error; }
std::uint64_t SourceFieldBuilder::photons() const { return impl_->photons(); }

std::shared_ptr<const SourceField> SourceFieldBuilder::snapshot() const {
  const FlushDenormals flush;
  const Impl& acoustic_scene = *impl_;
  const Impl::FieldImage finished = acoustic_scene.finish();
  const std::vector<Impl::CellImage>& cells = finished.cells;
  std::vector<FieldEntry> entries(cells.size());
  std::uint64_t num_values = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (cells[i].values.empty()) continue;
    entries[i] = {
        .first = cells[i].first, .count = static_cast<std::uint32_t>(cells[i].values.size() / acoustic_scene.row), .offset = num_values};
    num_values += cells[i].values.size();
  }
  FieldHeader header;
  header.key = source_field_key(acoustic_scene.scene, acoustic_scene.candidates);
  header.bytes = sizeof header + entries.size() * sizeof(FieldEntry) + num_values * sizeof(FieldValue);
  header.photons = acoustic_scene.photons();
  header.num_values = num_values;
  header.num_cells = static_cast<std::uint32_t>(entries.size());
  header.num_bins = static_cast<std::uint32_t>(acoustic_scene.num_bins);
  header.num_coefficients = static_cast<std::uint32_t>(acoustic_scene.num_coefficients);
  header.padded_bands = static_cast<std::uint32_t>(acoustic_scene.stride);
  header.bin_s = double{acoustic_scene.bin_s};
  header.t20_error = std::hypot(acoustic_scene.t20_error, finished.blur);
  header.nonfinite_dropped = acoustic_scene.nonfinite_dropped;

  const auto image = std::make_shared<std::vector<std::byte>>(header.bytes);
  std::byte* to = image->data();
  const auto append = [&to](std::span<const std::byte> part) { to = std::copy(part.begin(), part.end(), to); };
  append(std::as_bytes(std::span(&header, 1)));
  append(std::as_bytes(std::span(entries)));
  for (const Impl::CellImage& cell : cells) append(std::as_bytes(std::span(cell.values)));
  return std::make_shared<const SourceField>(acoustic_scene.scene, acoustic_scene.candidates, *image, image);
}

FieldBatches field_batches(const AcousticScene& scene, const EarlyCandidates& candidates, const SourceField& field, glm::vec3 listener) {
  const FlushDenormals flush;
  SourceFieldBuilder builder(scene, candidates);
  SourceFieldBuilder::Impl& in = *builder.impl_;
  in.at_listener.emplace(scene, candidates.source(), listener);
  const std::uint64_t photons = std::min(field.photons(), kMostPhotonsOfErrors);
  while (in.photons() < photons) in.trace_round();
  return in.batches(std::sqrt(static_cast<double>(in.photons()) / static_cast<double>(field.photons())));
}

std::shared_ptr<const SourceField> build_source_field_of(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                         std::uint64_t photons) {
  const FlushDenormals flush;
  SourceFieldBuilder builder(scene, candidates);
  while (builder.photons() < photons) builder.impl_->trace_round();
  return builder.snapshot();
}

std::shared_ptr<const SourceField> build_source_field(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                      const std::function<void(double fraction)>& progress) {
  SourceFieldBuilder builder(scene, candidates);
  while (builder.refine()) {
    if (!progress) continue;
    const double target = scene.config().field_error / builder.t20_error();
    const double done = static_cast<double>(builder.photons()) / scene.config().field_photons;
    progress(std::clamp(std::max(target * target, done), 0.0, 1.0));
  }
  return builder.snapshot();
}

}  // namespace earshot
