// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>

namespace earshot {

/// Evidence for where a sound is, by absolute bearing: a histogram over the circle to which every step adds the response of the ears for
/// each lateral angle, both where it lies in front and where it lies behind.  As the agent turns, the true bearing stays and its mirror
/// image moves by twice the turn, so that the sum tells front from back.  Old evidence decays, as the agent moves on.
class BearingMemory {
 public:
  static constexpr int kNumBins = 72;  ///< 5 degrees each, counter-clockwise

  void clear() {
    evidence_.fill(0);
    heard_ = 0;
  }
  /// response: of InterauralBearing, heard at this heading.
  void add(double heading_rad, std::span<const float> response);
  /// Ages the bearings by the distance walked; call once for each step forward.
  void age();
  /// The bearing with most evidence in radians, in (-pi, pi]; nothing before any sound.
  [[nodiscard]] std::optional<double> bearing_rad() const;
  [[nodiscard]] double evidence(int bin) const { return evidence_[static_cast<std::size_t>(bin)]; }

 private:
  std::array<double, kNumBins> evidence_{};
  int heard_ = 0;
};

}  // namespace earshot
