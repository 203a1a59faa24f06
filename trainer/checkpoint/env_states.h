// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "envs/batch/batched_env.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/collective/collective.h"
#include "trainer/rollout/rollout_collector.h"

namespace earshot {

/// Puts the environments and recurrent states of all workers into the checkpoint of every worker: env_states, hidden, not_done,
/// oracle_acted.  A collective call.  Throws RunError if the recurrent states differ in size.
void gather_env_states(Collective& collective, const BatchedEnv& env, const RolloutCollector& collector, Checkpoint& checkpoint);

/// Continues this worker's episodes where the checkpoint has them; identity: of this worker.  path: named by errors.  Throws InputError if
/// the checkpoint is of another number of workers or its recurrent state is not finite; then nothing has changed.
void restore_env_states(const Checkpoint& checkpoint, const std::filesystem::path& path, WorkerIdentity identity, BatchedEnv& env,
                        RolloutCollector& collector);

/// The same from a checkpoint of another number of workers: each environment goes on from origin_of_env().  One without an origin begins an
/// episode, with a zero recurrent state and seeds that are functions of its place, checkpoint.update and `seed`.  Bits depend on nothing
/// but the checkpoint and the number of workers.  set_hash: of the episode set of `env`; where the checkpoint has another set, all
/// environments begin anew.  Rank 0 logs moved_envs_text().  Throws InputError as restore_env_states.
void move_env_states(const Checkpoint& checkpoint, const std::filesystem::path& path, WorkerIdentity identity, std::uint64_t seed,
                     std::uint64_t set_hash, BatchedEnv& env, RolloutCollector& collector);

}  // namespace earshot
