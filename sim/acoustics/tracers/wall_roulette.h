// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace earshot {

/// Ends last segments that have little left behind walls, by Russian roulette (Arvo and Kirk 1990).
///
/// In a house nine in ten last segments are blocked.  To follow each through wall after wall takes four fifths of all rays, for sound some
/// 40 dB below the rest.  Here such a segment goes on by chance, and brings the more if it does, so that no mean changes: with the
/// probability of its contribution over half of what last segments have brought in the mean so far, at most 1.  Before its first wall
/// is known, that contribution is the mean of blocked ones, and the probability at least a fifth, so that a rare thin wall cannot bring
/// more than five times its share.  Contributions are compared per band, relative to what the path carries (late paths are not ended for
/// being late), and the largest ratio counts.  Where all that arrives comes through walls, the mean is that of walls: nothing ends that
/// matters.
///
/// One for each chunk of rays, in whose order it learns.
template <int W>
class WallRoulette {
 public:
  /// A segment that is blocked.  free: its contribution in free air; geometry: the same relative to the energy of the path; random: uniform
  /// in [0, 1).  Returns whether it is followed.
  [[nodiscard]] bool begin(const float (&free)[W], float geometry, float random) {
    for (int b = 0; b < W; ++b) relative_[b] = free[b] > 0.f ? geometry / free[b] : 0.f;
    random_ = random;
    probability_ = 1.f;
    if (segments_ < kLearning || blocked_ == 0.f) return true;
    float most = 0.f;
    for (int b = 0; b < W; ++b) most = std::max(most, sum_[b] > 0.f ? sum_blocked_[b] / sum_[b] : 0.f);
    if (has_segments_) probability_ = std::clamp(most * segments_ / (kFraction * blocked_), kLeast, 1.f);
    return random_ < probability_;
  }
  /// Is a segment of which `left` is left worth its next wall, which passes `passed` [W] of it?
  [[nodiscard]] bool goes_on(const float (&left)[W], const float* passed) {
    // Where nothing has arrived in any band there is nothing to compare with.
    if (segments_ < kLearning || !has_segments_) return true;
    float most = 0.f;
    for (int b = 0; b < W; ++b) most = std::max(most, sum_[b] > 0.f ? left[b] * relative_[b] * passed[b] / sum_[b] : 0.f);
    probability_ = std::min(probability_, most * segments_ / kFraction);
    return random_ < probability_;
  }
  /// The segment has arrived, with `left`, which gets what it is to bring.
  void arrive(float (&left)[W]) {
    const float factor = 1.f / probability_;
    for (int b = 0; b < W; ++b) {
      left[b] *= factor;
      sum_[b] += left[b] * relative_[b];
      sum_blocked_[b] += left[b] * relative_[b];
      has_segments_ = has_segments_ || sum_[b] > 0.f;
    }
    lose();
  }
  /// It has not.
  void lose() {
    segments_ += 1.f;
    blocked_ += 1.f;
  }
  /// A segment through free air.
  void arrive_freely(float geometry) {
    for (int b = 0; b < W; ++b) sum_[b] += geometry;
    has_segments_ = true;
    segments_ += 1.f;
  }

 private:
  static constexpr float kLearning = 64, kFraction = 0.5f, kLeast = 0.2f;
  float sum_[W] = {}, sum_blocked_[W] = {}, relative_[W] = {};
  float random_ = 0.f, probability_ = 1.f, segments_ = 0.f, blocked_ = 0.f;
  bool has_segments_ = false;
};

}  // namespace earshot
