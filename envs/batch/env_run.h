// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "envs/batch/agent_team.h"
#include "envs/batch/batch_rows.h"
#include "envs/batch/batched_env.h"
#include "envs/batch/episode_sounds.h"
#include "envs/hearing/agent_hearing.h"
#include "envs/scenes/scene_cache.h"
#include "envs/sensors/pending_pictures.h"
#include "envs/task/av_nav_task.h"

namespace earshot {

/// The state of one agent, without its observations.  Written by the thread that runs the task of its env; between tasks by the thread that
/// uses the batch.
struct Agent {
  // Constant after construction.
  std::size_t row = 0;  ///< of the batch
  int number = 0;       ///< in its env
  int env_id = 0;       ///< global

  Action action = Action::stop;
  // The same for all agents of an env.
  std::uint64_t seed = 0;    ///< of the draws of its episodes
  std::uint32_t stream = 0;  ///< which sequence of that seed
  std::uint64_t episode_index = 0;
  int episode_count = -1;                        ///< none begun
  std::shared_ptr<const EnvSource> source;       ///< of the goal
  std::shared_ptr<const Appearance> appearance;  ///< of its scene, where a camera wants colours or categories

  AvNavState state;
  StepOutcome outcome;  ///< until the task ends: rows belong to the batch from the moment in which it gives a task up
  bool waits = false;   ///< its part of the episode has ended, and others go on
  AgentHearing hearing;
  bool pictures_are_current = false;
  Pose start_pose, rendered_pose;
  std::vector<glm::vec3> path, goals;              ///< of the map: where it has been, and foot points of the goals
  BodiesAround around;                             ///< of the others, as it walks
  std::vector<AgentBody> others, rendered_others;  ///< as it sees them
  std::vector<float> clean_depth;                  ///< of one camera, before its noise
  PendingPictures pictures_now, pictures_last;     ///< by EGL: of the rows now, and of the last ones of an episode that has just ended
  std::vector<std::int8_t> spare_actions;          ///< storage for the actions of its next episode that ends
  std::vector<std::int8_t> actions;                ///< since the start of the episode; a step's is there before its task begins
  std::optional<FaultReport> fault;                ///< of this episode: its stages are skipped until it is quarantined, in this very step
  StageSeconds seconds;                            ///< not yet counted by the batch

  [[nodiscard]] bool has_ended() const { return state.terminated() || state.truncated(); }
  /// Whether it acts and observes.
  [[nodiscard]] bool runs() const { return !waits && !fault; }
  /// Of its draws: agents of an env have noise of their own.
  [[nodiscard]] std::uint64_t noise_seed() const { return seed + (static_cast<std::uint64_t>(number) << 56); }
};

/// Where an env is in its sequence of episodes.
enum class EpisodePhase : std::uint8_t {
  idle,     ///< no episode
  running,  ///< one has begun, and goes on
  ended,    ///< it has ended, and no other has begun
  voided,   ///< the same of one that was quarantined
};

/// The episode of one env and its agents, shared by the stages of a step.  Threads as Agent.
struct EnvRun {
  EpisodePhase phase = EpisodePhase::idle;
  int steps = 0;            ///< of the episode
  bool was_placed = false;  ///< an agent stands where no action has brought it: the actions do not say where the env is
  std::span<Agent> agents;
  EpisodeSounds sounds;
  std::vector<GeodesicField> other_goals;
  std::unique_ptr<AgentTeam> team;  ///< null: one thread does all of its agents

  [[nodiscard]] bool has_episode() const { return phase != EpisodePhase::idle; }
  [[nodiscard]] bool has_ended() const { return phase == EpisodePhase::ended || phase == EpisodePhase::voided; }
  /// Of the first agent that has one; null: none has.
  [[nodiscard]] const FaultReport* fault() const {
    for (const Agent& agent : agents)
      if (agent.fault) return &*agent.fault;
    return nullptr;
  }
  /// The goals of the episode; refers to what the episode holds.
  [[nodiscard]] NearestGoal goal_of(const Agent& agent) const {
    NearestGoal goal(agent.source->field);
    for (const GeodesicField& other : other_goals) goal.add(other);
    return goal;
  }
};

}  // namespace earshot
