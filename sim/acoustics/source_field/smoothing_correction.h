// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "sim/acoustics/core/widening_bins.h"
#include "sim/acoustics/geometry/field_smoothing.h"

namespace earshot {

/// What smoothing takes out of a field besides noise.  Beside a door to a livelier room energy falls by half within a metre, and a blur of
/// that size fills the shadow beside the door.  The blur's variance is one unit for every sweep, and one more for the cells themselves and
/// the blend between them, so energy after one sweep over energy after all of them, in windows of time, tells how much is missing: its
/// logarithm is continued along the variance to no blur at all (Richardson 1911).  What of it is more than noise, by the scatter inside
/// windows, is decided first for all of the time, then for the later half against the earlier, and so on (Haar wavelets shrunk by their
/// noise, Donoho and Johnstone 1994): where places are alike, nothing is corrected.  Immutable.
class SmoothingCorrection {
 public:
  /// Writes the energy [padded bands] of a cell in a merged bin before smoothing; false, and nothing written, if there is none.
  using RawEnergy = std::function<bool(std::uint32_t cell, std::size_t merged, std::span<float> energy)>;

  /// Keeps a reference to `bins`.  sweeps: [merged bins].  active: whole sets that FieldSmoothing::reachable gave.  Cost: 1 to
  /// 3 % of tracing the photons of `fast`.
  SmoothingCorrection(const FieldSmoothing& smoothing, const WideningBins& bins, std::span<const int> sweeps, std::size_t num_cells,
                      const std::vector<std::uint32_t>& active, std::size_t padded_bands, const RawEnergy& raw);

  /// Factors [padded bands] of a cell's smoothed energy in a merged bin; 1 before the first smoothed bin.
  void factors(std::uint32_t cell, std::size_t merged, std::span<float> to) const;
  /// Nothing is smoothed, so every factor is 1.
  [[nodiscard]] bool empty() const { return nodes_.empty(); }

 private:
  struct Window {
    std::vector<std::size_t> units;  ///< merged bins where the parts of the window begin, and where the last one ends
    int sweeps;
  };
  void find_windows(std::span<const int> sweeps);
  void measure(const FieldSmoothing& smoothing, const Window& window, const std::vector<std::uint32_t>& active, const RawEnergy& raw);
  void shrink(const std::vector<std::uint32_t>& active);

  const WideningBins& bins_;
  std::size_t num_cells_, stride_;
  std::vector<Window> windows_;
  /// [windows][cells][padded bands]: logarithm of what is missing, and its precision; zero precision where there is no energy.
  std::vector<std::vector<float>> missing_, precision_;
  std::vector<double> nodes_;                ///< bins at which factors are known, one more than windows: the first stands for no smoothing
  std::vector<std::vector<float>> factors_;  ///< [nodes][cells][padded bands]
};

}  // namespace earshot
