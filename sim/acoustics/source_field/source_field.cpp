// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/source_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/core/widening_bins.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/source_field/field_image.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// Values of a few merged bins at a time: they stay in the first cache.
constexpr std::size_t kBlockValues = 4096;
constexpr std::size_t kMinBlockBins = 3;
static_assert(kBlockValues >= kMinBlockBins * kMaxCoefficients * kMaxBands);

/// One cell's part of the sound at a listener.
struct Part {
  const FieldValue* values;
  std::size_t first, end;  ///< merged bins
  float weight;
};

/// sum: [merged bins from begin to end][coefficients][padded bands], of all parts.
void sum_parts(std::span<const Part> parts, std::size_t begin, std::size_t end, std::size_t row, float* sum) {
  std::fill_n(sum, (end - begin) * row, 0.f);
  for (const Part& part : parts) {
    const std::size_t from = std::max(begin, part.first), to = std::min(end, part.end);
    if (from >= to) continue;
    const FieldValue* values = part.values + (from - part.first) * row;
    float* out = sum + (from - begin) * row;
    // Rows are whole vectors of eight.
    for (std::size_t i = 0; i < (to - from) * row; i += 8)
      for (std::size_t lane = 0; lane < 8; ++lane) out[i + lane] += part.weight * from_field_value(values[i + lane]);
  }
}

/// One of three merged bins in a row.
struct MergedEnergy {
  const float* sum;  ///< [padded bands]
  float width;       ///< bins
};

/// How a late merged bin's energy lies over its bins: a line through the merged bin's mean, as steep as the neighbours make it but nowhere
/// below zero (monotonized central slope, van Leer 1977).  At the ends of what is known the one neighbour decides.  tilt: [padded bands],
/// change of a bin's fraction of the merged bin's energy from bin to bin.
void find_tilt(const MergedEnergy* before, MergedEnergy merged, const MergedEnergy* after, std::size_t stride, float* __restrict tilt) {
  std::fill_n(tilt, stride, 0.f);
  if (!before && !after) return;
  const float per_before = before ? 2.f / (before->width + merged.width) : 0.f,
              per_after = after ? 2.f / (merged.width + after->width) : 0.f;
  const float per_bin = 1.f / merged.width, steepest_of_mean = 2.f / (merged.width - 1);
  for (std::size_t band = 0; band < stride; ++band) {
    const float mean = merged.sum[band] * per_bin;
    const float fall = before ? (mean - before->sum[band] / before->width) * per_before : 0.f;
    const float rise = after ? (after->sum[band] / after->width - mean) * per_after : 0.f;
    const float down = before ? fall : rise, up = after ? rise : fall;
    const float least = 2 * std::min(std::fabs(down), std::fabs(up)), steepest = std::min(least, steepest_of_mean * mean);
    const bool same_way = (down > 0 && up > 0) || (down < 0 && up < 0);
    const float slope = same_way ? std::clamp(0.5f * (down + up), -steepest, steepest) : 0.f;
    tilt[band] = mean > 0 ? slope * per_bin / mean : 0.f;
  }
}

/// Adds the histories of all parts, whose values are [merged bin][coefficient][padded bands], to `histogram`.
void add_parts(std::span<const Part> parts, const WideningBins& bins, std::size_t stride, EnergyHistogram& histogram) {
  const auto coefficients = static_cast<std::size_t>(histogram.num_coefficients()), bands = static_cast<std::size_t>(histogram.num_bands());
  const std::size_t row = coefficients * stride, bins_per_block = kBlockValues / row;
  std::size_t first = bins.size(), last = 0;
  for (const Part& part : parts) first = std::min(first, part.first), last = std::max(last, part.end);
  alignas(32) std::array<float, kBlockValues> sum;
  std::array<float, kMaxBands> tilt;
  // A block ends where the next begins, but for the neighbours that its slopes need.
  for (std::size_t begin = first; begin < last;) {
    const std::size_t from = begin > first ? begin - 1 : begin, to = std::min(from + bins_per_block, last), end = to < last ? to - 1 : to;
    sum_parts(parts, from, to, row, sum.data());
    const auto energy_at = [&](std::size_t merged) {
      return MergedEnergy{&sum[(merged - from) * row], static_cast<float>(bins.width(merged))};
    };
    for (std::size_t merged = begin; merged < end; ++merged) {
      const float* merged_sum = &sum[(merged - from) * row];
      const std::size_t width = bins.width(merged);
      float* out = histogram.values().data() + bins.first_bin(merged) * bands * coefficients;
      if (width == 1) {
        for (std::size_t band = 0; band < bands; ++band)
          for (std::size_t k = 0; k < coefficients; ++k) *out++ += merged_sum[k * stride + band];
        continue;
      }
      // A single bin before the first wide merged bin says less of its slope than the merged bin after it.
      const bool has_before = merged > std::max(from, bins.fine()), has_after = merged + 1 < to;
      const MergedEnergy before = energy_at(has_before ? merged - 1 : merged), after = energy_at(has_after ? merged + 1 : merged);
      find_tilt(has_before ? &before : nullptr, energy_at(merged), has_after ? &after : nullptr, stride, tilt.data());
      for (std::size_t bin = 0; bin < width; ++bin) {
        const float from_middle = static_cast<float>(bin) - 0.5f * static_cast<float>(width - 1);
        for (std::size_t band = 0; band < bands; ++band) {
          // The steepest line ends at zero, from where rounding could take it below.
          const float fraction = std::max(1.f / static_cast<float>(width) + tilt[band] * from_middle, 0.f);
          for (std::size_t k = 0; k < coefficients; ++k) *out++ += fraction * merged_sum[k * stride + band];
        }
      }
    }
    begin = end;
  }
}

/// Part of the key: stored fields are built anew once photons or cells give other bits.  Raise it with every change of these bits.
constexpr std::uint32_t kPassVersion = 18;

FieldHeader header_of(std::span<const std::byte> image) {
  FieldHeader header;
  std::memcpy(&header, image.data(), sizeof header);
  return header;
}

template <class T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

WideningBins field_bins(const AcousticScene& scene, int num_bins) {
  const float bins_across = scene.diagonal_m() / (scene.speed_of_sound_m_per_s() * scene.config().time_bin_s);
  return WideningBins(num_bins, static_cast<std::size_t>(std::clamp(bins_across, 0.f, 1e6f)));
}

std::uint64_t source_field_key(const AcousticScene& scene, const EarlyCandidates& candidates) {
  const AcousticConfig& c = scene.config();
  std::string bytes;
  append(bytes, kPassVersion);
  append(bytes, WideningBins::kFine);
  append(bytes, WideningBins::kWide);
  append(bytes, scene.scene().hash());
  for (const int value :
       {scene.num_bands(), c.bands, c.max_bounces, c.field_photons, c.sh_order, scene.image_order(), c.early_candidate_rays})
    append(bytes, value);
  for (const float value : {c.time_bin_s, c.rir_length_s, c.scattering, c.sample_rate_hz, c.field_error, c.field_cell_m})
    append(bytes, value);
  for (const float exponent : scene.air_energy_per_m()) append(bytes, exponent);
  append(bytes, traces_transmission(scene));
  // Photons leave out the chains of mirrors that are found as images; with few rays those are fewer.
  if (candidates.long_chains())
    for (const std::uint32_t number : candidates.long_chains()->rule()) append(bytes, number);
  // Nor those of panels that have waves.
  for (const std::uint32_t index : candidates.diffraction().panels()) {
    const PanelShape& panel = scene.panel_shapes()->all()[index];
    for (const std::uint32_t number : {index, panel.plane, panel.base_plane}) append(bytes, number);
  }
  append(bytes, c.seed);
  const SoundSource& source = candidates.sound_source();
  append(bytes, source.position);
  append(bytes, source.radius_m);
  if (!candidates.emission().omnidirectional()) {
    // A pattern is what it radiates: its gains in directions enough to tell any two apart.
    std::array<float, kMaxBands> gain{};
    const SphereSequence directions(0, 0);
    for (std::uint32_t i = 0; i < 256; ++i) {
      candidates.emission().pressure(directions.direction(i), std::span(gain).first(static_cast<std::size_t>(scene.num_bands())));
      append(bytes, gain);
    }
  }
  return hash64(bytes);
}

SourceField::SourceField(const AcousticScene& scene, const EarlyCandidates& candidates, std::span<const std::byte> image,
                         std::shared_ptr<const void> owner)
    : image_(image), owner_(std::move(owner)), long_chains_(candidates.long_chains()) {
  const auto refuse = [](std::string_view problem) { throw InputError("source field", problem, "delete the file; it is built again"); };
  static_assert(sizeof(FieldHeader) % alignof(FieldEntry) == 0);
  if (image.size() < sizeof(FieldHeader)) refuse("is truncated");
  if (reinterpret_cast<std::uintptr_t>(image.data()) % alignof(FieldEntry) != 0) refuse("is not aligned to 8 bytes");
  const FieldHeader header = header_of(image);
  if (header.magic != FieldHeader::kMagic) refuse("is not a source field of this version");
  if (header.key != source_field_key(scene, candidates)) refuse("belongs to another scene, config or source");
  const EnergyHistogram shape = make_histogram(scene);
  if (header.num_cells != scene.field_grid().size() || header.num_bins != static_cast<std::uint32_t>(shape.num_bins()) ||
      header.num_coefficients != static_cast<std::uint32_t>(shape.num_coefficients()) ||
      header.padded_bands != static_cast<std::uint32_t>(scene.padded_bands()) || header.bin_s != double{shape.bin_s()})
    refuse("has a shape that does not match its scene");
  const std::uint64_t entries_bytes = std::uint64_t{header.num_cells} * sizeof(FieldEntry);
  if (header.bytes != image.size() || header.num_values > image.size() ||
      sizeof header + entries_bytes + header.num_values * sizeof(FieldValue) != image.size())
    refuse("is truncated");
  const auto* entries = reinterpret_cast<const FieldEntry*>(image.data() + sizeof header);
  const WideningBins bins = field_bins(scene, shape.num_bins());
  for (std::size_t i = 0; i < header.num_cells; ++i) {
    const FieldEntry& entry = entries[i];
    const std::uint64_t values = std::uint64_t{entry.count} * header.num_coefficients * header.padded_bands;
    if (entry.first > bins.size() || entry.count > bins.size() - entry.first || entry.offset > header.num_values ||
        values > header.num_values - entry.offset)
      refuse("is corrupted");
  }
}

std::uint64_t SourceField::photons() const { return header_of(image_).photons; }
std::uint64_t SourceField::nonfinite_dropped() const { return header_of(image_).nonfinite_dropped; }
double SourceField::t20_error() const { return header_of(image_).t20_error; }

TraceStats SourceField::gather(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const {
  const AcousticConfig& config = scene.config();
  histogram.clear();
  TraceStats stats;
  if (config.late == Switch::off || config.max_bounces == 0) return stats;
  const FieldHeader header = header_of(image_);
  stats.rays = header.photons;
  stats.nonfinite_dropped = header.nonfinite_dropped;
  const auto* entries = reinterpret_cast<const FieldEntry*>(image_.data() + sizeof header);
  const auto* values = reinterpret_cast<const FieldValue*>(entries + header.num_cells);
  std::array<FieldGrid::CellWeight, 8> shares;
  std::array<Part, 8> parts;
  const std::size_t count = scene.field_grid().blend(listener, shares);
  for (std::size_t i = 0; i < count; ++i) {
    const FieldEntry& entry = entries[shares[i].cell];
    parts[i] = {values + entry.offset, entry.first, std::size_t{entry.first} + entry.count, shares[i].weight};
  }
  add_parts(std::span(parts).first(count), field_bins(scene, histogram.num_bins()), header.padded_bands, histogram);
  if (long_chains_) long_chains_->add_late(scene, listener, histogram);
  return stats;
}

}  // namespace earshot
