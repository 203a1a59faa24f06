// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "envs/batch/agent_senses.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/env_run.h"
#include "envs/batch/env_state.h"

namespace earshot {

/// Brings the agents of one env, who have just entered their episode, to where a cursor says: walks its actions again, and leaves them with
/// the same state and the same bits in all observations.
///
/// Costs a walk of the whole episode, and a response for each pose of the last window of sound.  Earlier poses are walked, not rendered:
/// the sound depends on the poses of that window, and on the two steps before, by which paths arrive and which of them glide
/// (PathGlider::choose).
class EpisodeReplay {
 public:
  /// All arguments must outlive it.  engines: of the calling thread; null where no sensor hears.
  EpisodeReplay(const BatchSetup& setup, const AgentSenses& senses, EnvRun& run, const EnvCursor& cursor, HearingEngines* engines)
      : setup_(&setup), senses_(&senses), run_(&run), cursor_(&cursor), engines_(engines) {}

  /// Afterwards rows hold the observations of the cursor; of a running episode those whose part has ended wait.  Throws InputError where
  /// the actions do not end the episode as the cursor says.  A fault that is found on the way is noted at its agent.
  void walk();

 private:
  [[nodiscard]] const std::vector<std::int8_t>& actions_of(const Agent& agent) const;
  /// The first step that is heard.
  [[nodiscard]] std::size_t heard_from(const Agent& agent) const;
  /// The actions of one step.  Returns whether an agent hears it.
  bool move(std::size_t step);
  void hear(Agent& agent, std::size_t step);
  /// The observations at the cursor.
  void observe();

  const BatchSetup* setup_;
  const AgentSenses* senses_;
  EnvRun* run_;
  const EnvCursor* cursor_;
  HearingEngines* engines_;
};

}  // namespace earshot
