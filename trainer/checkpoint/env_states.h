// SPDX-License-Identifier: Apache-2.0
#pragma once

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

}  // namespace earshot
