#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/energy_histogram.h"
#include "sim/acoustics/field_grid.h"

namespace earshot {

/// A few listeners spread over the air that sound from the source reaches, with the energy that arrives at each while the field is being
/// built, kept apart by batches of photons: the spread of the batches says how well decay times are known (ORACLES 2.10).
class FieldProbes {
 public:
  static constexpr std::uint32_t kBatches = 8;
  static constexpr std::uint32_t kProbes = 16;

  /// Places the probes by random walks from the source.
  FieldProbes(const AcousticScene& scene, glm::vec3 source, const FieldGrid& grid);
  /// Energy [padded bands] that belongs to a cell at a path length.
  void add(std::uint32_t cell, float path_m, const float* energy, float factor, std::uint32_t batch) {
    if (begin_[cell] != begin_[cell + 1]) add_to_probes(cell, path_m, energy, factor, batch);
  }
  /// Relative standard error of T20 by the jackknife over batches, mean over probes and bands that have one; 1 if none has.
  [[nodiscard]] double t20_error() const;

 private:
  struct Reader {
    std::uint32_t probe;
    float weight;
  };
  void add_to_probes(std::uint32_t cell, float path_m, const float* energy, float factor, std::uint32_t batch);

  const AcousticScene* scene_;
  int num_bins_ = 0;
  float bins_per_m_ = 0;
  std::size_t stride_ = 0;
  std::vector<std::uint32_t> begin_;  ///< [cells + 1]: readers of each cell
  std::vector<Reader> readers_;
  std::vector<float> energy_;  ///< [batch][probe][bin][padded bands]
};

}  // namespace earshot
