// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envs/baselines/baselines.h"

namespace earshot {

/// Turns to the louder ear, walks where the depth image shows free space, stops when the sound is loud.  Where it is blocked, or has gone
/// nowhere for a while, it escapes: it turns to one side until the way is free, by more each time, and follows the free space without its
/// ears for longer each time.  Uses only what a policy observes, of which any may be off.  No map.
class GreedyAgent : public BaselineMemory {
 public:
  explicit GreedyAgent(const EnvConfig& config);
  void begin() override { memory_ = {}; }
  Action act(const BaselineObservation& observation, const RandomStream& random) override;

 private:
  struct Memory {
    int side = 0;           ///< +1: escapes to the left, -1: to the right; 0: hears
    int turns = 0;          ///< of the escape that are left at least
    int turned = 0;         ///< of the escape so far
    int walk = 0;           ///< forward steps that are left without ears
    int escapes = 0;        ///< since it last went somewhere
    int steps = 0;          ///< since the last check of progress
    bool explores = false;  ///< goes ahead whatever it hears, until that check
    Action last = Action::stop;
    double heading_rad = 0, x_m = 0, z_m = 0;  ///< by its own actions, from where progress was last checked
  };

  void escape(const BaselineObservation& observation, const RandomStream& random);
  void note_progress(bool collided);
  [[nodiscard]] float clearance_m(std::span<const float> depth, double from, double to) const;

  TaskConfig task_;
  CameraConfig camera_;
  float sound_gain_;
  Memory memory_;
};

}  // namespace earshot
