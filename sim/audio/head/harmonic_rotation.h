// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "sim/audio/head/listener_orientation.h"

namespace earshot {

/// Rotates real spherical harmonics of any order and direction: coefficients of a field in world axes into those in the axes of a listener.
/// Works for N3D and SN3D, as it mixes within an order only.  Matrices by the recursion of Ivanic and Ruedenberg 1996 (with the corrections
/// of 1998).
class HarmonicRotation {
 public:
  explicit HarmonicRotation(int order);  ///< in [0, 9]; the identity until set()
  /// O(order^3), no allocation.
  void set(const ListenerOrientation& orientation);
  [[nodiscard]] int order() const { return order_; }
  /// Weight of channel (l, n) of the world in channel (l, m) of the listener; m, n in [-l, l].
  [[nodiscard]] double at(int l, int m, int n) const { return matrix_[index(l, m, n)]; }
  /// coefficients: [(order + 1)^2], ACN, in place.
  void apply(std::span<float> coefficients) const;
  /// The same for signals: channels [(order + 1)^2], the first num_samples of each.
  void apply(std::span<const std::span<float>> channels, std::size_t num_samples);

 private:
  static constexpr std::size_t kBlock = 256;
  [[nodiscard]] static std::size_t index(int l, int m, int n) {
    return static_cast<std::size_t>(l * (2 * l - 1) * (2 * l + 1) / 3 + (l + m) * (2 * l + 1) + l + n);
  }
  [[nodiscard]] double product(int i, int l, int a, int b) const;

  int order_;
  std::vector<double> matrix_;
  std::vector<float> block_;  ///< [2 * order + 1][kBlock]
};

}  // namespace earshot
