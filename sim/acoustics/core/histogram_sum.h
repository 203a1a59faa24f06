// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"

namespace earshot {

/// Sum of histograms of one shape, in double and in the order in which they are added, so that neither their number nor threads change it.
/// A histogram adds in float: 1e7 equal contributions to one of its cells are off by 8.8 % (docs/evidence/oracles.md, O-25).  Tracers
/// therefore fill one for each block of rays, small enough for float, and add the blocks here (H-40).
class HistogramSum {
 public:
  explicit HistogramSum(const EnergyHistogram& shape) : sum_(shape.values().size(), 0.0) {}

  void add(const EnergyHistogram& part, double factor = 1.0) {
    const std::span<const float> values = part.values();
    for (std::size_t i = 0; i < sum_.size(); ++i) sum_[i] += factor * values[i];
    dropped_ += factor * part.dropped_energy();
  }
  /// histogram: of the same shape; overwritten.
  void write(EnergyHistogram& histogram) const {
    histogram.clear();
    std::transform(sum_.begin(), sum_.end(), histogram.values().begin(), [](double value) { return static_cast<float>(value); });
    histogram.add_dropped(dropped_);
  }

 private:
  std::vector<double> sum_;
  double dropped_ = 0;
};

}  // namespace earshot
