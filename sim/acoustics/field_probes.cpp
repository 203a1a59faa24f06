#include "sim/acoustics/field_probes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>

#include "sim/acoustics/late_errors.h"
#include "sim/acoustics/path_tracer.h"
#include "sim/acoustics/room_metrics.h"
#include "sim/acoustics/sampling.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Decay times need no fine bins to be judged.
constexpr int kBinsPerProbeBin = 4;

/// Half way along the last leg of a random walk; the walks go further from probe to probe.
glm::vec3 place_probe(const AcousticScene& scene, glm::vec3 source, std::uint32_t probe) {
  const RandomStream random(scene.config().seed, Purpose::field_probe, probe);
  const auto first = random.uniform2(0);
  glm::vec3 origin = source, direction = sphere_direction(first[0], first[1]), place = source;
  for (std::uint32_t leg = 1; leg <= probe + 2; ++leg) {
    const Hit hit = scene.scene().rays().intersect(origin, direction);
    if (!hit.valid()) break;
    place = 0.5f * (origin + hit.position);
    origin = offset_from_surface(hit.position, hit.normal);
    const auto u = random.uniform2(leg);
    direction = lambert_direction(hit.normal, u[0], u[1]);
  }
  return place;
}

}  // namespace

FieldProbes::FieldProbes(const AcousticScene& scene, glm::vec3 source, const FieldGrid& grid)
    : scene_(&scene), stride_(static_cast<std::size_t>(scene.padded_bands())) {
  const EnergyHistogram shape = make_histogram(scene);
  num_bins_ = (shape.num_bins() + kBinsPerProbeBin - 1) / kBinsPerProbeBin;
  bins_per_m_ = 1.f / (scene.speed_of_sound_m_per_s() * shape.bin_s() * kBinsPerProbeBin);
  energy_.assign(std::size_t{kBatches} * kProbes * static_cast<std::size_t>(num_bins_) * stride_, 0.f);

  std::vector<std::vector<Reader>> readers(grid.size());
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    std::array<FieldGrid::Share, 8> shares;
    const std::size_t count = grid.blend(place_probe(scene, source, probe), shares);
    for (std::size_t i = 0; i < count; ++i) readers[shares[i].cell].push_back({probe, shares[i].weight / grid.volume_m3(shares[i].cell)});
  }
  begin_.push_back(0);
  for (const std::vector<Reader>& of_cell : readers) {
    readers_.insert(readers_.end(), of_cell.begin(), of_cell.end());
    begin_.push_back(static_cast<std::uint32_t>(readers_.size()));
  }
}

void FieldProbes::add_to_probes(std::uint32_t cell, float path_m, const float* energy, float factor, std::uint32_t batch) {
  const float position = path_m * bins_per_m_;
  if (!(position < static_cast<float>(num_bins_))) return;
  const auto bin = static_cast<std::size_t>(position);
  for (std::uint32_t i = begin_[cell]; i < begin_[cell + 1]; ++i) {
    const Reader& reader = readers_[i];
    float* row = &energy_[((std::size_t{batch} * kProbes + reader.probe) * static_cast<std::size_t>(num_bins_) + bin) * stride_];
    for (std::size_t b = 0; b < stride_; ++b) row[b] += energy[b] * factor * reader.weight;
  }
}

double FieldProbes::t20_error() const {
  const auto bins = static_cast<std::size_t>(num_bins_), bands = static_cast<std::size_t>(scene_->num_bands());
  const double bin_s = 1.0 / (double{bins_per_m_} * scene_->speed_of_sound_m_per_s());
  std::vector<double> whole(bins), rest(bins);
  double sum = 0;
  int count = 0;
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    for (std::size_t band = 0; band < bands; ++band) {
      const auto at = [&](std::uint32_t batch, std::size_t bin) {
        return double{energy_[((std::size_t{batch} * kProbes + probe) * bins + bin) * stride_ + band]};
      };
      const double air_per_s = double{scene_->air_energy_per_m()[band]} * scene_->speed_of_sound_m_per_s();
      for (std::size_t bin = 0; bin < bins; ++bin) {
        whole[bin] = 0;
        for (std::uint32_t batch = 0; batch < kBatches; ++batch) whole[bin] += at(batch, bin);
      }
      std::array<std::optional<double>, kBatches> without;
      for (std::uint32_t batch = 0; batch < kBatches; ++batch) {
        for (std::size_t bin = 0; bin < bins; ++bin)
          rest[bin] = std::max(whole[bin] - at(batch, bin), 0.0) * std::exp(-air_per_s * (static_cast<double>(bin) + 0.5) * bin_s);
        without[batch] = measure_band(rest, bin_s, 0.0).t20_s;
      }
      const std::optional<double> error = jackknife_error(without);
      if (!error) continue;
      double mean = 0;
      for (const std::optional<double>& value : without) mean += *value / kBatches;
      if (!(mean > 0)) continue;
      sum += *error / mean;
      ++count;
    }
  }
  return count > 0 ? sum / count : 1.0;
}

}  // namespace earshot
