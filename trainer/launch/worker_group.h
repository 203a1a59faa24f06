// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "trainer/launch/launcher_environment.h"

namespace earshot {

/// Rank, world size, meeting point and run id of this process, from our own spawn or a launcher (launcher_environment.h), validated.
/// Where they meet on the loopback interface, with the keys that the run makes for itself (run_key.h), unless it has others or is insecure.
/// nullopt if this process is on its own; InputError if what is set contradicts itself.  The timeout is ten minutes: between two calls lies
/// a rollout, or the loading of a large scene, and workers differ; a dead one is noticed anyway.
std::optional<LaunchedWorker> worker_from_environment(const NetworkConfig& network = {});

/// Resources that workers inherit from the process that starts them.
struct Handed {
  std::vector<int> descriptors = {};        ///< open files; under the same numbers
  std::vector<std::string> variables = {};  ///< "NAME=VALUE", in the place of those of this process
};

/// Starts `num_workers` copies of this program and waits for all.  arguments: those after the program's name.  Each copy has EARSHOT_RANK,
/// _WORLD_SIZE, _RENDEZVOUS and _RUN_ID set, for a rendezvous in a private folder that is removed afterwards, and OMP_NUM_THREADS and
/// OPENBLAS_NUM_THREADS set to 1 unless they are set already (one thread per worker: docs/explanation/ppo.md, section 4).  Standard output
/// and error are inherited.  The first worker that fails stops the others (SIGTERM, after `grace` SIGKILL).  SIGINT, SIGTERM, SIGHUP and
/// SIGUSR1 are passed on; a second SIGINT or SIGTERM stops all in the same way.  Returns the exit code for main.  No worker outlives the
/// call, or the calling process. Call it before other threads exist. Throws RunError if no process can be started, InputError for a number
/// that validate_world() refuses.
///
/// Codes (exit_codes.h): 0 if all succeeded; that of a signal where they have ended in order after one; else that of the first worker that
/// failed by itself; kExitLostWorld where a worker was killed from outside, or none has failed but by the loss of others.
///
/// With OnLoss::go_on a worker that is killed, or ends with kExitLostWorld, stops no other, and the run has succeeded if a worker has;
/// processes that are then stopped, or still alive a minute later, are killed.  While the run is under way, a lost worker is started again
/// with
/// --join, `restarts` times in all; one that was started so ends no other, however it ends.
int spawn_workers(int num_workers, const std::vector<std::string>& arguments, std::chrono::milliseconds grace = std::chrono::seconds(5),
                  OnLoss on_loss = OnLoss::stop, int restarts = 0, const Handed& handed = {});

}  // namespace earshot
