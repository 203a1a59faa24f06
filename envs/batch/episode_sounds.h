// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>
#include <memory>
#include <span>
#include <vector>

#include "envs/batch/agent_team.h"
#include "envs/batch/batch_setup.h"
#include "envs/hearing/source_hearing.h"

namespace earshot {

struct Agent;

/// The sounds of the episode of one env: those of its sources, then those of its agents.  Used by the thread that runs the task of the env.
class EpisodeSounds {
 public:
  /// Makes the sounds of the episode that the agents have entered, and begins the hearing of each agent: it hears all sounds but its own,
  /// and noise where the episode has any.  Throws InputError for a place where no source can be made.
  void begin(const BatchSetup& setup, std::span<Agent> agents);
  /// Puts those that move where they are at the end of step `steps` (0: the start), once for all agents.  A sound that cannot be heard in
  /// this step stays.  engines: null where no agent hears; nothing moves.  team: threads that share the work; null: the caller does all.
  /// Rethrows the first error of a move.
  void move(const BatchSetup& setup, int steps, std::span<const Agent> agents, const HearingEngines* engines, AgentTeam* team);
  /// Lets go of the sounds and of the scene that they are in.
  void clear();

 private:
  struct Sound {
    PlayedSound played;
    std::unique_ptr<MovingSource> moving = nullptr;  ///< null: at rest
    int agent = -1;                                  ///< that makes it and does not hear it; -1: none
    std::exception_ptr error = nullptr;              ///< of its last move
  };
  void add_goal(const BatchSetup& setup, const Agent& lead);
  void add_source(const BatchSetup& setup, const Agent& lead, const EpisodeSource& source);
  void add_agents(const BatchSetup& setup, std::span<const Agent> agents);

  std::vector<Sound> sounds_;
  std::vector<std::shared_ptr<const EnvSource>> sources_;  ///< of sounds at rest, where the episode names them
  std::vector<PlayedSound> played_;                        ///< sound of one agent; a member, to reuse its storage
};

}  // namespace earshot
