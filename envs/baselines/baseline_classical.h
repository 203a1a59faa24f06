// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "envs/baselines/baselines.h"
#include "envs/baselines/bearing_memory.h"
#include "envs/baselines/grid_planner.h"
#include "envs/baselines/occupancy_grid.h"
#include "sim/audio/head/interaural_bearing.h"

namespace earshot {

/// Navigation without learning and without privileged state: the direction of the sound by the differences between the ears, kept by
/// absolute bearing while the agent turns; a map of what the depth camera has seen, by dead reckoning from its own actions (where a step
/// collided, the map says where it ended); walks on free cells towards the sound and, where the way is blocked, to the nearest frontier in
/// that direction (Yamauchi 1997, "A frontier-based approach for autonomous exploration").  Stops where the sound is loud and the ears
/// agree on its direction, which reverberation keeps them from far away; else goes back, with its last steps, to where that was most so.
class ClassicalAgent : public BaselineMemory {
 public:
  /// Throws InputError if the config lacks depth of the main camera or sound at the ears.
  explicit ClassicalAgent(const EnvConfig& config);
  void begin() override;
  Action act(const BaselineObservation& observation, const RandomStream& random) override;

  /// Cue for the distance of the source.
  struct NearnessCues {
    double level_db = -200;  ///< of the louder ear over the last second, per unit of EnvConfig::sound_gain
    double agreement = 0;    ///< of the ears with one direction (InterauralBearing), the mean of the last steps with sound
  };
  [[nodiscard]] const NearnessCues& cues() const { return cues_; }
  [[nodiscard]] const PlanarPose& pose() const { return pose_; }
  [[nodiscard]] const OccupancyGrid& grid() const { return grid_; }

 private:
  struct Place {
    double x_m = 0, z_m = 0;
  };

  void follow_own_motion(const BaselineObservation& observation);
  void listen(const BaselineObservation& observation);
  void remember_place(double score_db);
  /// Time to walk back to where it had sounded nearest, with what steps are left.
  [[nodiscard]] bool must_return() const;
  std::optional<GridCell> choose_target();
  std::optional<GridCell> along_bearing(double bearing_rad) const;
  std::optional<GridCell> frontier(double bearing_rad) const;
  [[nodiscard]] Action walk_to(GridCell target) const;

  TaskConfig task_;
  float sound_gain_;
  InterauralBearing ears_;
  OccupancyGrid grid_;
  GridPlanner planner_;
  std::vector<float> response_, newest_;

  PlanarPose pose_;
  BearingMemory bearing_;
  NearnessCues cues_;
  Action last_ = Action::stop;
  Action look_ = Action::left;  ///< to which side it turns at the start
  int steps_ = 0;
  Place nearest_;                     ///< where it sounded nearest so far
  double nearest_score_db_ = 0;       ///< how near; -inf: nowhere yet
  bool returns_ = false;              ///< walks there
  std::vector<Place> blocked_;        ///< where the way to the sound had ended
  std::vector<Place> seen_;           ///< frontiers that were visited, or not reached in time
  std::optional<GridCell> frontier_;  ///< that it walks to
  int frontier_steps_ = 0;
};

}  // namespace earshot
