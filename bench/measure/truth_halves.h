// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "bench/measure/bench_scene.h"
#include "bench/measure/converged_reference.h"
#include "bench/measure/response_errors.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// The truth at some poses as two independent halves, so that the noise of neither enters an error (response_errors.h): bidirectional paths
/// as in the preset `high`, no field, image paths of order four and all edges, fewer rays a run and more runs.  Every run at every pose has
/// a seed of its own, which no tested mode uses, so that errors at two poses have nothing in common.  Not thread-safe.
class TruthHalves {
 public:
  /// rays: listener rays of one run, with a quarter of them from the source.  Throws InputError as AcousticScene.
  TruthHalves(std::shared_ptr<const Scene> scene, glm::vec3 source, std::vector<WalkPose> poses, int rays);

  /// One more run of either half at every pose.
  void add_round();
  [[nodiscard]] int rounds() const { return rounds_; }
  [[nodiscard]] double seconds() const { return seconds_; }  ///< that all rounds have taken
  /// Relative standard error of T20 of the mean of both halves, root mean square over poses and bands; NaN where nothing decays.
  [[nodiscard]] double t20_error() const;

  [[nodiscard]] const AcousticScene& acoustics() const { return acoustics_; }
  [[nodiscard]] const std::vector<WalkPose>& poses() const { return poses_; }
  [[nodiscard]] EnergyResponse half(std::size_t pose, int which) const;  ///< mean of its runs
  [[nodiscard]] EnergyResponse mean(std::size_t pose) const;             ///< of both

 private:
  AcousticScene acoustics_;
  EarlyCandidates candidates_;
  std::vector<WalkPose> poses_;
  std::array<std::vector<EnergyResponse>, 2> sums_;
  int rounds_ = 0;
  double seconds_ = 0;
};

/// Rays of a run that are enough, and few enough, in a few minutes of two cores.
inline constexpr int kTruthRays = 8192;

}  // namespace earshot
