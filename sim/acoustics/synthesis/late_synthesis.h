// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/late_carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"

namespace earshot {

/// Turns late energy into pressure.  Owns scratch: one per thread; no allocation once warm.
///
/// One channel: p = sum over bands of sqrt(energy density) * carrier.  The density is interpolated linearly between the bins of
/// late_envelope.h.  (N + 1)^2 channels (N3D, ACN, world axes): the omnidirectional channel is the same, s w with w its carrier;
/// the others are
///   s (m_j w + d_l n_j),   m_j = c_j / c_0,   d_l^2 = 1 - |m of order l|^2 / (2 l + 1)
/// with independent carriers n_j.  That has exactly the moments of the histogram: power c_0 in W, covariance c_j between W and
/// channel j, and power (2 l + 1) c_0 in each order.  m = 0 is a diffuse field; |m|^2 = 2 l + 1 a plane wave.  Orders that the histogram
/// does not hold are diffuse.
class LateSynthesizer {
 public:
  /// channels: spans of the length of the envelope, at most as many as the bank has, one or
  /// at least four.  The first num_bins bins count, and
  /// only what they reach is written.  place: set for the envelope.  Returns how much of each channel sounds: behind it, all are zero or
  /// not written.
  std::size_t render(const LateEnvelope& envelope, int num_bins, const CarrierBank& carriers, LateCarriers& place,
                     std::span<const std::span<float>> channels);

 private:
  /// One channel above first order.
  struct HigherAmplitude {
    float m = 0, d = 1;
  };
  void make_higher(const LateEnvelope& envelope, int num_bins, std::size_t num_channels);

  std::vector<HigherAmplitude> higher_;  ///< [band][bin][channel - 4]
};

}  // namespace earshot
