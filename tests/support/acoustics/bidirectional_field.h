// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "tests/support/acoustics/late_field.h"

/// Late fields by the bidirectional tracer, with the standard errors that it states itself.
namespace earshot::rooms {

struct BidirectionalField {
  EnergyHistogram histogram;
  LateBatches batches;
  TraceStats stats;

  /// Mean and standard error over batches of sum_bins energy * weight(time).
  template <class Weight>
  [[nodiscard]] Sample sum(int band, Weight weight) const {
    double mean = 0, squares = 0;
    for (int batch = 0; batch < batches.count; ++batch) {
      double value = 0;
      for (int bin = 0; bin < batches.num_bins; ++bin) value += batches.at(batch, bin, band) * weight((bin + 0.5) * histogram.bin_s());
      mean += value;
      squares += value * value;
    }
    mean /= batches.count;
    return {mean, std::sqrt(std::max(0.0, squares / batches.count - mean * mean) / (batches.count - 1))};
  }
  [[nodiscard]] Sample total(int band = 0) const {
    return sum(band, [](double) { return 1.0; });
  }
};

inline BidirectionalField bidirectional_field(const std::shared_ptr<const Scene>& room, const AcousticConfig& config,
                                              const SoundSource& source, glm::vec3 listener, const BidirectionalOptions& options = {}) {
  const AcousticScene scene(room, config);
  BidirectionalField field{.histogram = make_histogram(scene), .batches = {}, .stats = {}};
  field.stats = trace_bidirectional(scene, EarlyCandidates(scene, source), listener, field.histogram, &field.batches, options);
  return field;
}

/// plain_config with a bidirectional tracer of equal numbers of rays from both ends.
inline AcousticConfig bidirectional_config(int rays) {
  AcousticConfig config = plain_config();
  config.rays = config.source_rays = rays;
  return config;
}

/// Within `sigmas` standard errors, which must themselves be below `fraction` of the value: tight enough to see a lost factor.
inline void expect_near(const Sample& sample, double expected, double sigmas, double fraction, const char* message = "") {
  EXPECT_NEAR(sample.mean, expected, sigmas * sample.standard_error) << message << ": standard error " << sample.standard_error;
  EXPECT_LT(sample.standard_error, fraction * expected) << message;
}
inline void expect_same(const Sample& a, const Sample& b, double sigmas, double fraction, const char* message = "") {
  const double error = std::hypot(a.standard_error, b.standard_error);
  EXPECT_NEAR(a.mean, b.mean, sigmas * error) << message << ": standard errors " << a.standard_error << ", " << b.standard_error;
  EXPECT_LT(error, fraction * a.mean) << message;
}

}  // namespace earshot::rooms
