// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "envs/batch/batch_rows.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/env_run.h"
#include "envs/task/oracle_counts.h"

namespace earshot {

/// Chooses the episodes of the envs of a batch, and brings the agents of an env into one: scene, goal, start and sounds, without an
/// observation.  Calls for different envs may run at the same time.
class EpisodeEntry {
 public:
  /// setup, rows: must outlive it.
  EpisodeEntry(const BatchSetup& setup, const BatchRows& rows);

  /// The episode number `count` of the env of this agent; attempt: of EpisodeOrder::random, where episodes before could not begin.  None:
  /// the sequence is over (EpisodeOrder::once).  No allocation.
  [[nodiscard]] std::optional<std::uint64_t> choose(const Agent& agent, int count, std::uint32_t attempt) const;
  /// Loads scene and sources of an episode in the background, where the config says so.
  void prefetch(std::uint64_t episode_index) const;

  /// The agents as they are before their episode begins; the env runs from then on.
  void prepare(EnvRun& run, std::uint64_t episode_index, int episode_count) const;
  /// Scene, source, starts and sounds of the episode that prepare() has named.  Reports a fault of an agent that has no way to the goal.
  /// Throws InputError for a scene, a place or a sound that cannot be used.
  void enter(EnvRun& run);
  /// Lets go of the scene and all that belongs to it.
  static void leave(EnvRun& run);

 private:
  void enter_agent(const EnvRun& run, Agent& agent, double silent_from_s);

  const BatchSetup* setup_;
  bool keeps_path_;  ///< for the map
  bool looks_;       ///< a camera wants colours or categories
  OracleCounts oracle_;
};

}  // namespace earshot
