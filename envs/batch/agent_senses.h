// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "envs/batch/agent_camera.h"
#include "envs/batch/batch_rows.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/env_run.h"
#include "envs/batch/fault_desk.h"
#include "envs/batch/picture_queue.h"
#include "envs/batch/stage_clock.h"

namespace earshot {

/// The stages of a step for one agent: move, trace, synthesize, convolve, render, observe.  Each reads the agent's state and writes its
/// row; a stage that finds a value that is not finite notes a fault, and the later ones do nothing then.
///
/// engines: of the calling thread; null where no sensor hears.
/// Threads: calls for different agents may run at the same time, but move() for agents of one env.  Stages may throw (a scene that cannot
/// be read, memory); callers guard them (FaultDesk::guard).  A stage allocates only until its buffers have grown to what the poses need.
class AgentSenses {
 public:
  /// All arguments must outlive it.
  AgentSenses(const BatchSetup& setup, BatchRows& rows, std::span<const AgentCamera> cameras, const PictureQueue& pictures,
              const FaultDesk& faults)
      : setup_(&setup), rows_(&rows), cameras_(cameras), pictures_(&pictures), faults_(&faults) {}

  /// The action, by the rules of the task, in the way of no other agent of the env.
  void move(const EnvRun& run, Agent& agent, Action action) const;
  /// Energy responses at the ears.  block: samples that are heard with them.
  void trace(Agent& agent, HearingEngines* engines, int block) const;
  /// RIRs of the responses.
  void synthesize(Agent& agent, HearingEngines* engines) const;
  /// The sound of the step: rows `waveform` and `heard`.
  void convolve(Agent& agent, HearingEngines* engines) const;
  /// The pictures; those that EGL draws are left to the PictureQueue.
  void render(const EnvRun& run, Agent& agent) const;
  /// All other rows.
  void observe(const EnvRun& run, Agent& agent, HearingEngines* engines) const;

  /// The stages after move(), each booked.  goes_on: asked before each stage; false: the task has been given up.  Returns whether it goes
  /// on.
  template <class GoesOn>
  bool sense(const EnvRun& run, Agent& agent, HearingEngines* engines, StageClock& clock, const GoesOn& goes_on) const;
  /// The observation before the first step; the window before it is heard as if the agent had stood there.
  void observe_start(const EnvRun& run, Agent& agent, HearingEngines* engines) const;
  /// The window of sound before the first step.  False: it is not finite.
  bool fill_window(Agent& agent, HearingEngines& engines) const;

  /// Zeros the observation.
  void clear(Agent& agent) const;
  /// The observation now becomes the last one of the episode.
  void keep(Agent& agent) const;
  /// An agent whose part has ended: its last observation is kept, and it waits for the others.
  void end_part(Agent& agent) const;

 private:
  void see_others(const EnvRun& run, Agent& agent) const;
  bool draw_by_embree(Agent& agent, std::size_t camera, const Pose& pose, const DepthNoiseDraw& noise) const;
  void observe_sound(Agent& agent, HearingEngines& engines) const;
  void observe_way(Agent& agent) const;
  void observe_goal(const EnvRun& run, Agent& agent) const;
  void add_pose_noise(const Agent& agent, std::span<float> reading) const;

  const BatchSetup* setup_;
  BatchRows* rows_;
  std::span<const AgentCamera> cameras_;
  const PictureQueue* pictures_;
  const FaultDesk* faults_;
};

template <class GoesOn>
bool AgentSenses::sense(const EnvRun& run, Agent& agent, HearingEngines* engines, StageClock& clock, const GoesOn& goes_on) const {
  bool is_running = true;
  const auto stage = [&](Stage which, const auto& body) {
    is_running = is_running && goes_on();
    if (!is_running) return;
    if (agent.runs()) faults_->guard(agent, Fault::stage, body);
    clock.book(which);
  };
  stage(Stage::trace, [&] { trace(agent, engines, setup_->block_samples); });
  stage(Stage::synthesize, [&] { synthesize(agent, engines); });
  stage(Stage::convolve, [&] { convolve(agent, engines); });
  stage(Stage::render, [&] { render(run, agent); });
  stage(Stage::observe, [&] { observe(run, agent, engines); });
  return is_running;
}

}  // namespace earshot
