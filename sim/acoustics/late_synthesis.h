#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/carriers.h"
#include "sim/acoustics/energy_histogram.h"

namespace earshot {

/// Turns the late energy of a histogram into pressure.  Owns scratch: one per thread; no allocation once warm.
///
/// One channel: p = sum over bands of sqrt(energy density) * carrier.  The density is interpolated linearly between bin centres, which
/// keeps each bin's energy.  Four channels (N3D, ACN, world axes): the omnidirectional channel is the same, s w with w its carrier; the
/// others are
///   s (m_j w + d n_j),   m = (c1, c2, c3) / c0,   d^2 = 1 - |m|^2 / 3
/// with independent carriers n_j.  That has exactly the moments that a first-order histogram knows: power c0 in W, covariance c_j between W
/// and channel j, and power 3 c0 in the three together.  m = 0 is a diffuse field; |m|^2 = 3 a plane wave.
class LateSynthesizer {
 public:
  explicit LateSynthesizer(float sample_rate_hz) : rate_hz_(sample_rate_hz) {}

  /// channels: [carriers.num_channels()] spans of equal length, overwritten.  offset: where in the carrier loops time zero lies.
  /// onset_sample: nothing is written before it; energy of bins that reach before it lands behind it.  Returns the number of samples
  /// after which all are zero.
  std::size_t render(const EnergyHistogram& energy, const CarrierBank& carriers, std::size_t offset, double onset_sample,
                     std::span<const std::span<float>> channels);

 private:
  /// One band at one bin centre.
  struct Node {
    float density = 0;  ///< energy per sample
    std::array<float, 3> m{};
    float d = 1;
  };
  void make_nodes(const EnergyHistogram& energy, double onset_sample, std::size_t num_samples);

  float rate_hz_;
  std::vector<Node> nodes_;       ///< [band][bin]
  std::vector<double> hat_area_;  ///< [bin]: samples over which a bin spreads
};

}  // namespace earshot
