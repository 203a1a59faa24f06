// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <optional>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

struct TemporalReuseConfig {
  float least_weight = 0.1f;     ///< of the new frame: 0.1 leaves a / (2 - a) = 5 % of the variance, as 19 frames would, (0, 1]
  float max_bias_db = 0.5f;      ///< of the late level under the drift that is expected of the motion, > 0
  float drift_db_per_m = 0.33f;  ///< expected change of the late level per metre within a room (docs/explanation/estimators.md, section 8:
                                 ///< 0.05 dB per 0.15 m), >= 0
  float max_move_m = 0.5f;       ///< of source and listener together; a longer step forgets the past, > 0
};
/// Throws InputError.
void validate(const TemporalReuseConfig& config);

/// Late fields along a trajectory where a source or a listener moves, blended from frame to frame so that fewer rays do
/// (docs/explanation/estimators.md, section 8):
///   E_n = (1 - a) M(E_{n-1}) + a Ê_n,
/// where Ê_n is traced with rays of its own and M shifts by the change of the direct sound's delay.  Direct sound, early reflections,
/// diffraction and transmission are those of the pose, never blended.
///
/// a is the largest of four: config.least_weight; the weight that makes the variance least (1/2, 1/3, ... while frames are few); the weight
/// that minimises bias^2 + variance for the drift g (dB per frame) expected of the motion, (g (1 - a) / a)^2 + s^2 a / (2 - a), with the
/// noise s of the late level of single frames as it was seen; and g / (g + max_bias_db), which bounds the bias of steady drift by
/// max_bias_db. a = 1, the past forgotten, where the source comes into sight or goes out of it, after a move of more than max_move_m, in
/// another scene, and where the new frames differ from the past by more than their noise explains (3.5 standard errors of the smoothed
/// difference: a doorway between rooms far from the source).  So drift that the motion does not announce leaves a bias of at most about 1.5
/// s.
///
/// Not a function of the pose alone: of all poses since forget().  The frame after forget(), and after a move that forgets, has the bits of
/// compute_energy_response.
class TemporalReuse {
 public:
  explicit TemporalReuse(const TemporalReuseConfig& config = {});

  /// As compute_energy_response, for the next frame of a trajectory.  Each frame traces with a seed of its own, the first with
  /// that of the config.  A few table copies beyond the trace; no allocation once warm.
  void compute(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response);
  /// The next frame starts a trajectory.
  void forget() { frame_ = 0; }
  /// The a of the last frame.
  [[nodiscard]] double weight() const { return weight_; }

 private:
  struct Place {
    glm::vec3 source{0}, listener{0};
    glm::quat orientation{1, 0, 0, 0};
    bool in_sight = false;
    std::uint64_t scene = 0;
  };
  [[nodiscard]] bool continues(const Place& place, const EnergyHistogram& late) const;
  [[nodiscard]] double choose_weight(double drift_db) const;
  void blend(double shift_bins, EnergyHistogram& late);
  void watch_level(const EnergyHistogram& late, bool moved);

  TemporalReuseConfig config_;
  Place before_;
  EnergyHistogram past_;                 ///< E_{n-1}, without the gain of walls
  std::optional<AcousticScene> seeded_;  ///< the scene with this frame's seed
  std::uint64_t frame_ = 0;              ///< since forget()
  double past_variance_ = 1;             ///< of past_, in units of a single frame's
  double weight_ = 1;
  // Level of single frames: noise from second differences, which steady drift leaves out, and smoothed difference from the past.
  int levels_ = 0;
  double level_db_ = 0, level_before_db_ = 0, noise_db2_ = 0, difference_db_ = 0, difference_weight_ = 0;
};

}  // namespace earshot
