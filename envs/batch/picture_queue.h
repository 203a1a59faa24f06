// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <memory>
#include <span>
#include <vector>

#include "envs/batch/agent_camera.h"
#include "envs/batch/env_run.h"
#include "envs/batch/fault_desk.h"
#include "sim/vision/egl_renderer.h"

namespace earshot {

/// Pictures of pinholes that EGL draws for many envs at once.  Tasks leave what their agents want to see (Agent::pictures_now and
/// pictures_last); the thread that gathers the tasks collects it from all of them and draws it before it hands the envs back:
///
///   for (Agent& agent : of_done_tasks) queue.collect(agent);
///   seconds += queue.draw();
///
/// Once the driver fails, Embree draws what is waiting, and tasks draw their own pictures from then on.
class PictureQueue {
 public:
  /// Opens the device that spec.renderer asks for.  cameras, faults: must outlive it.  Throws InputError or RunError where `egl` is asked
  /// for and no device is there, or where a device is named that does not exist.
  PictureQueue(const ObservationSpec& spec, std::span<const AgentCamera> cameras, const FaultDesk& faults);

  /// Whether tasks leave the pictures of pinholes to the queue.  Safe from any thread.
  [[nodiscard]] bool draws() const { return draws_.load(std::memory_order_relaxed); }
  /// Takes what the last task of the agent's env has left.  The agent must stay until draw().  Does nothing without EGL.
  void collect(Agent& agent);
  /// Draws all that was collected into its rows, and forgets it.  Returns the seconds that it took.
  double draw();

 private:
  struct Waiting {
    const Agent* agent;
    bool last;  ///< in the rows of the last observation
    PendingPictures* pictures;
  };
  void draw_camera(std::size_t index);
  void draw_by_egl(const CameraSensorConfig& config);

  const ObservationSpec* spec_;
  std::span<const AgentCamera> cameras_;
  const FaultDesk* faults_;
  std::unique_ptr<EglRenderer> egl_;  ///< null: Embree draws all
  std::atomic<bool> draws_{false};    ///< until the driver fails
  // Of one draw; members so that their storage is kept.
  std::vector<Waiting> waiting_;
  std::vector<EglView> views_;  ///< of one camera
  std::vector<float> depth_;    ///< before its noise
};

}  // namespace earshot
