// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/field_probes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <optional>
#include <span>
#include <utility>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/core/jackknife.h"
#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/paths/band_lanes.h"
#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Decay times need no fine bins to be judged.
constexpr int kBinsPerProbeBin = 4;

/// Fraction of a probe's weights that may be left out, in the cells that count least.
constexpr float kDroppedFraction = 0.05f;

/// Places where sound arrives with less than this fraction of the mean energy of all probes do not count: decay times behind many doors,
/// some 30 dB below the loudest place, would take most of the photons.
constexpr double kFaint = 0.005;

/// Fraction of the places whose blur is stated.
constexpr double kCovered = 0.9;

/// A random walk from the source.
struct Walk {
  glm::vec3 place;  ///< half way along the last segment
  double length_m = 0;
  int segments = 0;
  bool escaped = false;
};

/// Walks go further from probe to probe.
Walk walk_to_probe(const AcousticScene& scene, glm::vec3 source, std::uint32_t probe) {
  const RandomStream random(scene.config().seed, Purpose::field_probe, probe);
  const auto first = random.uniform2(0);
  glm::vec3 origin = source, direction = sphere_direction(first[0], first[1]);
  Walk walk{.place = source};
  for (std::uint32_t segment = 1; segment <= probe + 2; ++segment) {
    const Hit hit = scene.scene().rays().intersect(origin, direction);
    if (!hit.valid()) {
      walk.escaped = true;
      break;
    }
    walk.place = 0.5f * (origin + hit.position);
    walk.length_m += glm::distance(origin, hit.position);
    ++walk.segments;
    origin = offset_from_surface(hit.position, hit.normal);
    const auto u = random.uniform2(segment);
    direction = lambert_direction(hit.normal, u[0], u[1]);
  }
  return walk;
}

/// Probes for a source in closed air: a point in each of so many equal parts of the volume that its sound reaches, taken in the order of
/// the cells, so spread over all rooms.  Walks stay where they begin: their probes know nothing of rooms behind a few doors.
std::vector<glm::vec3> spread_probes(const FieldGrid& grid, const FieldSmoothing& smoothing, glm::vec3 source) {
  std::array<FieldGrid::CellWeight, 8> around;
  std::vector<bool> is_source_cell(grid.size(), false);
  const std::size_t count = grid.blend(source, around);
  for (std::size_t i = 0; i < count; ++i) is_source_cell[around[i].cell] = true;
  const std::vector<std::uint32_t> cells = smoothing.reachable(is_source_cell);
  double volume_m3 = 0, before_m3 = 0;
  for (const std::uint32_t cell : cells) volume_m3 += double{grid.volume_m3(cell)};
  std::vector<glm::vec3> places;
  for (const std::uint32_t cell : cells) {
    before_m3 += double{grid.volume_m3(cell)};
    const double part = (static_cast<double>(places.size()) + 0.5) / FieldProbes::kProbes;
    if (places.size() < FieldProbes::kProbes && before_m3 >= part * volume_m3) places.push_back(grid.inside(cell));
  }
  return places;
}

}  // namespace

FieldProbes::FieldProbes(const AcousticScene& scene, int bins_per_probe_bin)
    : scene_(&scene), bins_per_probe_bin_(bins_per_probe_bin), stride_(static_cast<std::size_t>(scene.padded_bands())) {
  const EnergyHistogram shape = make_histogram(scene);
  num_bins_ = (shape.num_bins() + bins_per_probe_bin - 1) / bins_per_probe_bin;
  bins_per_m_ = 1.f / (scene.speed_of_sound_m_per_s() * shape.bin_s() * static_cast<float>(bins_per_probe_bin));
}

std::vector<glm::vec3> FieldProbes::walk_from(glm::vec3 source, bool& escaped) {
  std::vector<glm::vec3> places;
  double length_m = 0;
  int segments = 0;
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    const Walk walk = walk_to_probe(*scene_, source, probe);
    places.push_back(walk.place);
    length_m += walk.length_m;
    segments += walk.segments;
    escaped = escaped || walk.escaped;
  }
  if (segments > 0) mean_free_path_m_ = length_m / segments;
  return places;
}

FieldProbes::FieldProbes(const AcousticScene& scene, glm::vec3 source) : FieldProbes(scene, kBinsPerProbeBin) {
  bool escaped = false;
  std::vector<glm::vec3> places = walk_from(source, escaped);
  if (!escaped)
    if (std::vector<glm::vec3> spread = spread_probes(scene.field_grid(), scene.field_smoothing(), source); spread.size() == kProbes)
      places = std::move(spread);
  find_readers(scene.field_grid(), scene.field_smoothing(), places);
}

FieldProbes::FieldProbes(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) : FieldProbes(scene, 1) {
  bool escaped = false;
  walk_from(source, escaped);
  find_readers(scene.field_grid(), scene.field_smoothing(), {listener});
}

/// With which weights each probe reads the cells, for every number of sweeps.
void FieldProbes::find_readers(const FieldGrid& grid, const FieldSmoothing& smoothing, const std::vector<glm::vec3>& places) {
  tally_of_cell_.assign(grid.size(), FieldGrid::no_cell);
  const auto num_probes = static_cast<std::uint32_t>(places.size());
  width_ = (places.size() + kLanes - 1) / kLanes * kLanes;
  std::vector<float> weights(grid.size() * width_, 0.f), spare;
  std::vector<bool> read(grid.size(), false);
  for (std::uint32_t probe = 0; probe < num_probes; ++probe) {
    std::array<FieldGrid::CellWeight, 8> shares;
    const std::size_t count = grid.blend(places[probe], shares);
    around_.emplace_back(shares.begin(), shares.begin() + static_cast<std::ptrdiff_t>(count));
    for (std::size_t i = 0; i < count; ++i) {
      weights[shares[i].cell * width_ + probe] += shares[i].weight;
      read[shares[i].cell] = true;
    }
  }
  const std::vector<std::uint32_t> active = smoothing.reachable(read);
  std::vector<std::pair<float, std::uint32_t>> order;
  for (int sweeps = 0; sweeps <= FieldSmoothing::kMaxSweeps; ++sweeps) {
    if (sweeps > 0) smoothing.sweep(1, width_, active, weights, spare);
    for (std::uint32_t probe = 0; probe < num_probes; ++probe) {
      order.clear();
      for (const std::uint32_t cell : active)
        if (const float weight = weights[cell * width_ + probe]; weight > 0) order.emplace_back(weight, cell);
      std::sort(order.begin(), order.end(),
                [](const auto& a, const auto& b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
      double read_weight = 0;
      std::size_t count = 0;
      while (count < order.size() && read_weight < 1 - kDroppedFraction) read_weight += order[count++].first;
      std::vector<Reader>& readers = readers_.emplace_back();
      for (std::size_t i = 0; i < count; ++i) {
        std::uint32_t& tally = tally_of_cell_[order[i].second];
        if (tally == FieldGrid::no_cell) {
          tally = static_cast<std::uint32_t>(energy_.size());
          energy_.emplace_back();
        }
        readers.push_back({tally, static_cast<float>(order[i].first / (read_weight * grid.volume_m3(order[i].second)))});
      }
    }
  }
}

int FieldProbes::sweeps_at(double time_s) const {
  return scene_->field_smoothing().sweeps_at(time_s, mean_free_path_m_, scene_->speed_of_sound_m_per_s());
}

void FieldProbes::add_to_tally(std::uint32_t tally, float path_m, const float* energy, float length_m, std::uint32_t batch) {
  const float position = path_m * bins_per_m_;
  if (!(position < static_cast<float>(num_bins_))) return;
  const auto bins = static_cast<std::size_t>(num_bins_);
  std::vector<float>& of_cell = energy_[tally];
  if (of_cell.empty()) of_cell.assign(kBatches * bins * stride_, 0.f);
  float* row = &of_cell[(batch * bins + static_cast<std::size_t>(position)) * stride_];
  for (std::size_t b = 0; b < stride_; b += 8)
    for (std::size_t lane = 0; lane < 8; ++lane) row[b + lane] += energy[b + lane] * length_m;
}

/// Energy at a probe.  energy: [batch][bin][padded bands].
void FieldProbes::read(std::uint32_t probe, std::vector<float>& energy) const {
  const auto bins = static_cast<std::size_t>(num_bins_);
  const double bin_s = 1.0 / (double{bins_per_m_} * scene_->speed_of_sound_m_per_s());
  energy.assign(kBatches * bins * stride_, 0.f);
  for (std::size_t first = 0, last; first < bins; first = last) {
    const int sweeps = sweeps_at((static_cast<double>(first) + 0.5) * bin_s);
    for (last = first + 1; last < bins && sweeps_at((static_cast<double>(last) + 0.5) * bin_s) == sweeps;) ++last;
    for (const Reader& reader : readers_[static_cast<std::size_t>(sweeps) * around_.size() + probe]) {
      const std::vector<float>& of_cell = energy_[reader.tally];
      if (of_cell.empty()) continue;
      for (std::uint32_t batch = 0; batch < kBatches; ++batch)
        for (std::size_t i = (batch * bins + first) * stride_; i < (batch * bins + last) * stride_; i += 8)
          for (std::size_t lane = 0; lane < 8; ++lane) energy[i + lane] += reader.weight * of_cell[i + lane];
    }
  }
}

/// Energy of all bands and times at the probes, unsmoothed.
std::vector<double> FieldProbes::probe_levels() const {
  std::vector<double> of_tally(energy_.size(), 0.0), levels(kProbes, 0.0);
  for (std::size_t tally = 0; tally < energy_.size(); ++tally) {
    std::array<double, kLanes> sum{};
    for (std::size_t i = 0; i < energy_[tally].size(); i += kLanes)
      for (std::size_t lane = 0; lane < kLanes; ++lane) sum[lane] += double{energy_[tally][i + lane]};
    of_tally[tally] = std::accumulate(sum.begin(), sum.end(), 0.0);
  }
  for (std::uint32_t probe = 0; probe < kProbes; ++probe)
    for (const Reader& reader : readers_[static_cast<std::size_t>(FieldSmoothing::kMaxSweeps) * kProbes + probe])
      levels[probe] += double{reader.weight} * of_tally[reader.tally];
  return levels;
}

double FieldProbes::t20_error() const {
  const auto bins = static_cast<std::size_t>(num_bins_), bands = static_cast<std::size_t>(scene_->num_bands());
  const double bin_s = 1.0 / (double{bins_per_m_} * scene_->speed_of_sound_m_per_s());
  std::vector<double> whole(bins), rest(bins);
  std::vector<float> energy;
  double sum = 0;
  int count = 0;
  const std::vector<double> levels = probe_levels();
  const double mean_level = std::accumulate(levels.begin(), levels.end(), 0.0) / kProbes;
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    if (levels[probe] < kFaint * mean_level) continue;
    read(probe, energy);
    for (std::size_t band = 0; band < bands; ++band) {
      const auto at = [&](std::uint32_t batch, std::size_t bin) { return double{energy[(batch * bins + bin) * stride_ + band]}; };
      const double air_per_s = double{scene_->air_energy_per_m()[band]} * scene_->speed_of_sound_m_per_s();
      for (std::size_t bin = 0; bin < bins; ++bin) {
        whole[bin] = 0;
        for (std::uint32_t batch = 0; batch < kBatches; ++batch) whole[bin] += at(batch, bin);
      }
      std::array<std::optional<double>, kBatches> t20_without_batch;
      for (std::uint32_t batch = 0; batch < kBatches; ++batch) {
        for (std::size_t bin = 0; bin < bins; ++bin)
          rest[bin] = std::max(whole[bin] - at(batch, bin), 0.0) * std::exp(-air_per_s * (static_cast<double>(bin) + 0.5) * bin_s);
        t20_without_batch[batch] = measure_band(rest, bin_s, 0.0).t20_s;
      }
      const std::optional<double> error = jackknife_error(t20_without_batch);
      if (!error) continue;
      double mean = 0;
      for (const std::optional<double>& value : t20_without_batch) mean += *value / kBatches;
      if (!(mean > 0)) continue;
      sum += *error / mean;
      ++count;
    }
  }
  return count > 0 ? sum / count : 1.0;
}

bool FieldProbes::read_factors(std::uint32_t probe, const SmoothingCorrection& correction, const WideningBins& bins,
                               std::vector<double>& factors) const {
  factors.assign(static_cast<std::size_t>(num_bins_) * stride_, 0.0);
  std::array<float, kMaxBands> of_cell{};
  bool is_corrected = false;
  for (std::size_t bin = 0; bin < static_cast<std::size_t>(num_bins_); ++bin) {
    const std::size_t merged = bins.merged_bin_of(bin * static_cast<std::size_t>(bins_per_probe_bin_));
    for (const FieldGrid::CellWeight& around : around_[probe]) {
      correction.factors(around.cell, std::min(merged, bins.size() - 1), of_cell);
      for (std::size_t b = 0; b < stride_; ++b) {
        factors[bin * stride_ + b] += double{around.weight} * double{of_cell[b]};
        is_corrected = is_corrected || of_cell[b] != 1.f;
      }
    }
  }
  return is_corrected;
}

double FieldProbes::t20_blur(const SmoothingCorrection& correction, const WideningBins& bins) const {
  if (correction.empty()) return 0;
  const auto num_bins = static_cast<std::size_t>(num_bins_);
  const double bin_s = 1.0 / (double{bins_per_m_} * scene_->speed_of_sound_m_per_s());
  const std::vector<double> levels = probe_levels();
  const double mean_level = std::accumulate(levels.begin(), levels.end(), 0.0) / kProbes;
  std::vector<double> factors, blurred(num_bins), corrected(num_bins);
  std::vector<float> energy;
  std::vector<double> changes;  // of each probe that counts
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    if (levels[probe] < kFaint * mean_level) continue;
    if (!read_factors(probe, correction, bins, factors)) {
      changes.push_back(0);
      continue;
    }
    read(probe, energy);
    double change = 0;
    int count = 0;
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene_->num_bands()); ++band) {
      const double air_per_s = double{scene_->air_energy_per_m()[band]} * scene_->speed_of_sound_m_per_s();
      for (std::size_t bin = 0; bin < num_bins; ++bin) {
        blurred[bin] = 0;
        for (std::uint32_t batch = 0; batch < kBatches; ++batch) blurred[bin] += double{energy[(batch * num_bins + bin) * stride_ + band]};
        blurred[bin] *= std::exp(-air_per_s * (static_cast<double>(bin) + 0.5) * bin_s);
        corrected[bin] = blurred[bin] * factors[bin * stride_ + band];
      }
      const std::optional<double> before_s = measure_band(blurred, bin_s, 0.0).t20_s, after_s = measure_band(corrected, bin_s, 0.0).t20_s;
      if (!before_s || !after_s || !(*before_s > 0)) continue;
      change += std::fabs(*after_s / *before_s - 1);
      ++count;
    }
    if (count > 0) changes.push_back(change / count);
  }
  if (changes.empty()) return 0;
  const auto most = std::min(static_cast<std::size_t>(kCovered * static_cast<double>(changes.size())), changes.size() - 1);
  std::nth_element(changes.begin(), changes.begin() + static_cast<std::ptrdiff_t>(most), changes.end());
  return changes[most];
}

}  // namespace earshot
