// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "trainer/checkpoint/checkpoint.h"

namespace earshot {

/// Which part of the environments each rank of a start has (Checkpoint::members).
struct EnvPlaces {
  std::vector<int> members;
  int started_workers = 0;
  bool are_moved = false;  ///< the checkpoint is of another number of workers
  [[nodiscard]] int first_of(int rank) const { return members[static_cast<std::size_t>(rank)]; }
};

/// Of a run that is started, or that goes on from a checkpoint.  changes: keys that the user allows to differ (RunStart::changes).
/// Throws InputError if the checkpoint is of another number of workers and "workers" is not among them.
EnvPlaces env_places_of(const std::optional<Checkpoint>& resumed, int world_size, const std::vector<std::string>& changes);

/// One environment in a checkpoint: the `env`-th of its `rank`-th worker.
struct EnvOrigin {
  int rank = 0, env = 0;
};

/// Where environment `place` of a start with another number of workers goes on from.  Environments keep their order: counted by worker,
/// then within the worker, place i takes the i-th of the checkpoint.  nullopt: the checkpoint has fewer, and the environment begins anew.
/// saved_workers, saved_envs: workers of the checkpoint, and environments of each.
std::optional<EnvOrigin> origin_of_env(int place, int saved_workers, int saved_envs);

/// A line on that: how many go on, begin anew and are dropped.
std::string moved_envs_text(int saved_workers, int saved_envs, int workers, int envs);

}  // namespace earshot
