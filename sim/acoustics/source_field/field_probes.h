// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/geometry/field_smoothing.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/source_field/smoothing_correction.h"

namespace earshot {

/// A few listeners spread over the air that sound from the source reaches, the same volume to each, with the energy that arrives there,
/// smoothed as the field will be, held apart by batches of photons: the spread of the batches says how well decay times are known
/// (docs/explanation/estimators.md, section 10).
class FieldProbes {
 public:
  static constexpr std::uint32_t kBatches = 8;
  static constexpr std::uint32_t kProbes = 16;

  /// Places kProbes probes in parts of equal volume; where sound escapes, on random walks from the source.
  FieldProbes(const AcousticScene& scene, glm::vec3 source);
  /// One probe, at `listener`, with the bins of the scene.
  FieldProbes(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener);

  /// Mean length of the segments of those walks.
  [[nodiscard]] double mean_free_path_m() const { return mean_free_path_m_; }
  /// Sweeps of smoothing for energy of this age, as the field gets them.
  [[nodiscard]] int sweeps_at(double time_s) const;

  /// Energy [padded bands] times a length, that belongs to a cell at a path length.
  void add(std::uint32_t cell, float path_m, const float* energy, float length_m, std::uint32_t batch) {
    if (tally_of_cell_[cell] != FieldGrid::no_cell) add_to_tally(tally_of_cell_[cell], path_m, energy, length_m, batch);
  }
  /// Prefetches the memory that add() of the same will change: the first line of it, which holds 16 bands.
  void fetch(std::uint32_t cell, float path_m, std::uint32_t batch) const {
    const std::uint32_t tally = tally_of_cell_[cell];
    const float position = path_m * bins_per_m_;
    if (tally == FieldGrid::no_cell || energy_[tally].empty() || !(position < static_cast<float>(num_bins_))) return;
    __builtin_prefetch(&energy_[tally][(batch * static_cast<std::size_t>(num_bins_) + static_cast<std::size_t>(position)) * stride_], 1);
  }
  /// Relative standard error of T20 by the jackknife over batches, mean over bands that have one and over probes where sound is no more
  /// than 23 dB below its mean; 1 if none has.
  [[nodiscard]] double t20_error() const;
  /// Second term of the relative error of T20, from the blur of smoothing and cells: the 90th percentile over the probes of the change by
  /// the correction, averaged over bands, because about as much error again remains.  0 without a correction.
  [[nodiscard]] double t20_blur(const SmoothingCorrection& correction, const WideningBins& bins) const;

  /// Energy that arrives at a probe, smoothed, without loss in air: [kBatches][bins][padded bands].
  void read(std::uint32_t probe, std::vector<float>& energy) const;

 private:
  struct Reader {
    std::uint32_t tally;
    float weight;
  };
  void find_readers(const FieldGrid& grid, const FieldSmoothing& smoothing, const std::vector<glm::vec3>& places);
  void add_to_tally(std::uint32_t tally, float path_m, const float* energy, float length_m, std::uint32_t batch);
  /// Factors [bins][padded bands] that the correction has at a probe; false if it has none there.
  bool read_factors(std::uint32_t probe, const SmoothingCorrection& correction, const WideningBins& bins,
                    std::vector<double>& factors) const;
  [[nodiscard]] std::vector<double> probe_levels() const;

  /// Sets the bins: this many of the scene's as one.
  FieldProbes(const AcousticScene& scene, int bins_per_probe_bin);
  /// Sets the mean free path by walks from the source; where they end, in order.  escaped: some left the scene.
  std::vector<glm::vec3> walk_from(glm::vec3 source, bool& escaped);

  const AcousticScene* scene_;
  int bins_per_probe_bin_;
  std::size_t width_ = 0;  ///< of rows of weights: one for each probe, in whole vectors of eight
  double mean_free_path_m_ = 0;
  int num_bins_ = 0;
  float bins_per_m_ = 0;
  std::size_t stride_ = 0;
  std::vector<std::uint32_t> tally_of_cell_;                ///< cells that some probe reads
  std::vector<std::vector<Reader>> readers_;                ///< [sweeps][probe]
  std::vector<std::vector<FieldGrid::CellWeight>> around_;  ///< [probe] cells that a listener there reads
  std::vector<std::vector<float>> energy_;                  ///< [tally][batch][bin][padded bands]; empty where no photon came
};

}  // namespace earshot
