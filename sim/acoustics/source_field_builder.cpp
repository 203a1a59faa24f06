#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "sim/acoustics/field_image.h"
#include "sim/acoustics/field_probes.h"
#include "sim/acoustics/photon_pass.h"
#include "sim/acoustics/source_field.h"
#include "sim/audio/ambisonics.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::uint32_t kChunksPerRound = FieldProbes::kBatches;  // photons come in whole rounds: a chunk for each batch
constexpr std::uint64_t kPhotonsPerRound = std::uint64_t{kChunksPerRound} * kPhotonsPerChunk;

/// to[i] += factor * from[i]; count: a multiple of eight, whole vectors.
void add_scaled(const float* from, float factor, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; i += 8)
    for (std::size_t lane = 0; lane < 8; ++lane) to[i + lane] += factor * from[i + lane];
}

}  // namespace

struct SourceFieldBuilder::Impl {
  Impl(const AcousticScene& in, const EarlyCandidates& of)
      : scene(in), candidates(of), grid(in.field_grid()), probes(in, of.source(), grid), history(grid.size()) {
    const EnergyHistogram shape = make_histogram(in);
    num_bins = shape.num_bins();
    num_coefficients = shape.num_coefficients();
    bin_s = shape.bin_s();
    stride = static_cast<std::size_t>(in.padded_bands());
    row = static_cast<std::size_t>(num_coefficients) * stride;
  }

  /// Adds energy times length to bins of one cell, split between the two whose centres are nearest, as EnergyHistogram::add does.
  void add(std::uint32_t cell, float path_m, const float* weighted, float length_m) {
    const float from_centre = path_m / (scene.speed_of_sound_m_per_s() * bin_s) - 0.5f;
    if (!(from_centre < static_cast<float>(num_bins))) return;
    std::vector<float>& bins = history[cell];
    if (bins.empty()) bins.assign(static_cast<std::size_t>(num_bins) * row, 0.f);
    const auto bin = static_cast<int>(std::floor(from_centre));
    const float to_next = bin >= 0 && bin + 1 < num_bins ? from_centre - static_cast<float>(bin) : 0.f;
    float* here = &bins[static_cast<std::size_t>(std::clamp(bin, 0, num_bins - 1)) * row];
    const float keep = length_m * (1.f - to_next), pass = length_m * to_next;
    add_scaled(weighted, keep, row, here);
    if (pass > 0) add_scaled(weighted, pass, row, here + row);
  }

  void add(const PhotonTracks& of_chunk, std::uint32_t batch) {
    std::array<float, kMaxCoefficients> sh{};
    std::array<float, kMaxCoefficients * kMaxBands> weighted{};
    for (std::size_t i = 0; i < of_chunk.flights.size(); ++i) {
      const PhotonTracks::Flight& flight = of_chunk.flights[i];
      const float* energy = &of_chunk.energy[i * stride];
      // The harmonics are those of where sound comes from.
      spherical_harmonics_n3d(-flight.direction, scene.config().sh_order, sh);
      for (int k = 0; k < num_coefficients; ++k)
        for (std::size_t b = 0; b < stride; ++b) weighted[static_cast<std::size_t>(k) * stride + b] = sh[k] * energy[b];
      for (std::uint32_t c = flight.first_crossing; c < flight.end_crossing; ++c) {
        const FieldGrid::Crossing& crossing = of_chunk.crossings[c];
        const float length_m = crossing.leave_m - crossing.enter_m;
        const float path_m = flight.path_m + 0.5f * (crossing.enter_m + crossing.leave_m);
        add(crossing.cell, path_m, weighted.data(), length_m);
        probes.add(crossing.cell, path_m, energy, length_m, batch);
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
        tbb::parallel_for(0u, kChunksPerRound,
                          [&](std::uint32_t i) { trace_photons(scene, candidates, grid, first + i, tracks[i], stats[i]); });
      });
      for (std::uint32_t i = 0; i < kChunksPerRound; ++i) add(tracks[i], i);
    }
    ++rounds;
  }

  [[nodiscard]] std::uint64_t photons() const { return rounds * kPhotonsPerRound; }

  const AcousticScene& scene;
  const EarlyCandidates& candidates;
  const FieldGrid& grid;
  FieldProbes probes;
  int num_bins = 0, num_coefficients = 0;
  float bin_s = 0;
  std::size_t stride = 0, row = 0;          ///< padded bands; times coefficients
  std::vector<std::vector<float>> history;  ///< [cells][bins][coefficients][padded bands]; empty where no photon came
  std::array<PhotonTracks, kChunksPerRound> tracks;
  std::uint32_t rounds = 0;
  double t20_error = 1;
};

SourceFieldBuilder::SourceFieldBuilder(const AcousticScene& scene, const EarlyCandidates& candidates)
    : impl_(std::make_unique<Impl>(scene, candidates)) {}
SourceFieldBuilder::~SourceFieldBuilder() = default;
SourceFieldBuilder::SourceFieldBuilder(SourceFieldBuilder&&) noexcept = default;

bool SourceFieldBuilder::refine() {
  Impl& in = *impl_;
  const AcousticConfig& config = in.scene.config();
  const auto most =
      static_cast<std::uint32_t>(std::max<std::uint64_t>(static_cast<std::uint64_t>(config.field_photons) / kPhotonsPerRound, 1));
  if (in.rounds >= most || (in.rounds > 0 && in.t20_error <= double{config.field_error})) return false;
  std::uint32_t add = 1;
  if (in.rounds > 0) {
    // The error falls as the root of the photons: as many as that asks for, but between an eighth more and four times as many.
    const double ratio = in.t20_error / config.field_error;
    const double wanted = in.rounds * std::clamp(ratio * ratio, 1.125, 4.0);
    add = std::max(1u, static_cast<std::uint32_t>(std::ceil(wanted)) - in.rounds);
  }
  for (const std::uint32_t end = std::min(in.rounds + add, most); in.rounds < end;) in.trace_round();
  in.t20_error = in.probes.t20_error();
  return true;
}

double SourceFieldBuilder::t20_error() const { return impl_->t20_error; }
std::uint64_t SourceFieldBuilder::photons() const { return impl_->photons(); }

std::shared_ptr<const SourceField> SourceFieldBuilder::snapshot() const {
  const Impl& in = *impl_;
  std::vector<FieldEntry> entries(in.history.size());
  std::uint64_t num_values = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::vector<float>& history = in.history[i];
    const auto any = [](float value) { return value != 0.f; };
    const auto first = std::find_if(history.begin(), history.end(), any);
    if (first == history.end()) continue;
    const auto last = std::find_if(history.rbegin(), history.rend(), any).base() - 1;
    entries[i].first = static_cast<std::uint32_t>(static_cast<std::size_t>(first - history.begin()) / in.row);
    entries[i].count = static_cast<std::uint32_t>(static_cast<std::size_t>(last - history.begin()) / in.row) + 1 - entries[i].first;
    entries[i].offset = num_values;
    num_values += entries[i].count * in.row;
  }
  FieldHeader header;
  header.key = source_field_key(in.scene, in.candidates);
  header.bytes = sizeof header + entries.size() * sizeof(FieldEntry) + num_values * sizeof(FieldValue);
  header.photons = in.photons();
  header.num_values = num_values;
  header.num_cells = static_cast<std::uint32_t>(entries.size());
  header.num_bins = static_cast<std::uint32_t>(in.num_bins);
  header.num_coefficients = static_cast<std::uint32_t>(in.num_coefficients);
  header.padded_bands = static_cast<std::uint32_t>(in.stride);
  header.bin_s = double{in.bin_s};
  header.t20_error = in.t20_error;

  const auto image = std::make_shared<std::vector<std::byte>>(header.bytes);
  std::memcpy(image->data(), &header, sizeof header);
  std::memcpy(image->data() + sizeof header, entries.data(), entries.size() * sizeof(FieldEntry));
  // Air once, here: path length is c t (ORACLES 3.2).
  std::vector<double> kept(static_cast<std::size_t>(in.num_bins) * in.stride, 0.0);
  for (int bin = 0; bin < in.num_bins; ++bin) {
    const double path_m = (bin + 0.5) * in.bin_s * in.scene.speed_of_sound_m_per_s();
    for (int band = 0; band < in.scene.num_bands(); ++band)
      kept[static_cast<std::size_t>(bin) * in.stride + static_cast<std::size_t>(band)] =
          std::exp(-double{in.scene.air_energy_per_m()[band]} * path_m);
  }
  auto* values = reinterpret_cast<FieldValue*>(image->data() + sizeof header + entries.size() * sizeof(FieldEntry));
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].count == 0) continue;
    // Fluence is track length per volume; the energy of the Green's function is that over 4 pi (ORACLES 0.1).
    const double per_photon = 1.0 / static_cast<double>(std::max<std::uint64_t>(in.photons(), 1));
    const double scale = per_photon / (4.0 * std::numbers::pi * double{in.grid.volume_m3(static_cast<std::uint32_t>(i))});
    const float* from = &in.history[i][entries[i].first * in.row];
    for (std::uint32_t bin = entries[i].first; bin < entries[i].first + entries[i].count; ++bin) {
      std::array<float, kMaxBands> factor{};
      for (std::size_t b = 0; b < in.stride; ++b) factor[b] = static_cast<float>(scale * kept[bin * in.stride + b]);
      for (int k = 0; k < in.num_coefficients; ++k)
        for (std::size_t b = 0; b < in.stride; ++b) *values++ = to_field_value(*from++ * factor[b]);
    }
  }
  return std::make_shared<const SourceField>(in.scene, in.candidates, *image, image);
}

std::shared_ptr<const SourceField> build_source_field(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                      const std::function<void(double share)>& progress) {
  SourceFieldBuilder builder(scene, candidates);
  while (builder.refine()) {
    if (!progress) continue;
    const double target = scene.config().field_error / builder.t20_error();
    const double share = static_cast<double>(builder.photons()) / scene.config().field_photons;
    progress(std::clamp(std::max(target * target, share), 0.0, 1.0));
  }
  return builder.snapshot();
}

}  // namespace earshot
