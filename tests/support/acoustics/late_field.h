// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <memory>

#include "sim/acoustics/tracers/path_tracer.h"
#include "tests/support/acoustics/rooms.h"

/// Late fields of test rooms and their statistics over seeds.
namespace earshot::rooms {

struct Sample {
  double mean = 0, standard_error = 0;
};

/// Mean and standard error of a quantity over seeds.
template <class Measure>
Sample over_seeds(int count, AcousticConfig config, Measure measure) {
  double sum = 0, squares = 0;
  for (int seed = 1; seed <= count; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const double value = measure(config);
    sum += value;
    squares += value * value;
  }
  const double mean = sum / count;
  return {mean, std::sqrt(std::max(0.0, squares / count - mean * mean) / (count - 1))};
}

inline EnergyHistogram late_field(const std::shared_ptr<const Scene>& room, const AcousticConfig& config, glm::vec3 source,
                                  glm::vec3 listener, TraceStats* stats = nullptr) {
  const AcousticScene scene(room, config);
  EnergyHistogram histogram = make_histogram(scene);
  const TraceStats result = trace_late(scene, source, listener, histogram);
  if (stats) *stats = result;
  return histogram;
}

inline double laplace_sum(const EnergyHistogram& h, double sigma) {
  double sum = 0;
  for (int i = 0; i < h.num_bins(); ++i) sum += h.energy(i, 0) * std::exp(-sigma * (i + 0.5) * h.bin_s());
  return sum;
}

}  // namespace earshot::rooms
