// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_claim.h"
#include "trainer/collective/collective.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// How a run starts.
struct RunStart {
  std::filesystem::path resume = {};      ///< checkpoint file to go on from; empty: a new run
  bool elastic = false;                   ///< go on from the newest checkpoint in config.out if there is one, with any number of workers
  bool overwrite = false;                 ///< a new run removes the files of an earlier one in config.out first
  std::vector<std::string> changes = {};  ///< keys or sections in which a resumed run may differ from its checkpoint, and "engine"
  std::string note = {};                  ///< a line on the run that rank 0 prints once it may start; may be empty
  std::shared_ptr<RunLock> lock = {};     ///< on config.out, where this process has it already; null: rank 0 takes it
  std::string remake = "earshot dataset episodes --config CONFIG";  ///< command that makes the episode sets anew, for messages
};

/// Parts of prepare_run that need no planned acoustics: whether the folder is free and the options fit each other, and whether the episode
/// set is that of config.train.  Throw InputError as prepare_run; remove nothing.
void refuse_mixed_runs(const RunConfig& config, const RunStart& start);
void refuse_stale_episodes(const RunConfig& config, const RunStart& start);

/// Decides whether the run may start, so that it never mixes with another one, and removes the earlier run if it is to be overwritten.
/// Throws InputError, one line:
///   - a new run, and config.out holds checkpoints (unless overwrite);
///   - a resumed run, and config.out holds checkpoints of another run than the one it goes on from;
///   - a resumed run with another config (effective_config.h) or another engine than its checkpoint, unless declared in changes;
///   - an episode set that was made from other keys than config.train says (episode_data.h);
///   - overwrite together with resume or elastic; changes without resume or elastic; a declared key that no config has.
/// Of one process only: before the workers are spawned, and of rank 0.
void prepare_run(const RunConfig& config, const RunStart& start);

/// The newest checkpoint in config.out; empty if there is none.  Throws InputError if all are damaged.
std::filesystem::path newest_checkpoint(const RunConfig& config);

/// RunStart::changes, and "workers" for an elastic start.
std::vector<std::string> allowed_changes(const RunStart& start);

/// Whether the checkpoint is of the end of the run, as far as total_steps and, with schedule minutes, max_minutes tell.
bool has_reached_end(const RunConfig& config, const CheckpointMetadata& checkpoint);

struct PreparedRun {
  RunClaim claim;
  std::filesystem::path resume;  ///< checkpoint to go on from, the same on every rank; empty: none
};

/// Takes the lock on config.out unless start.lock has it, and prepare_run, on rank 0; every rank throws InputError if it refuses.  Of an
/// elastic start rank 0 chooses the checkpoint once it has the lock: what workers of an earlier start have saved by then counts.  A
/// collective call.
PreparedRun prepare_run(const RunConfig& config, const RunStart& start, Collective& collective);

}  // namespace earshot
