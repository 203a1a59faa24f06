#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "trainer/collective.h"

namespace earshot {

/// Rank, world size and meeting point of this process, from the environment variables EARSHOT_RANK, EARSHOT_WORLD_SIZE, EARSHOT_RENDEZVOUS
/// and EARSHOT_RUN_ID that spawn_workers sets (or a launcher does).  nullopt if none is set; InputError if they contradict each other. The
/// timeout is ten minutes: between two calls lies a rollout, or the loading of a large scene, and workers differ; a dead one is noticed
/// anyway.
std::optional<RingConfig> worker_from_environment();

/// Starts `num_workers` copies of this program and waits for all.  arguments: those after the program's name.  Each copy has the variables
/// above set, for a rendezvous in a private folder that is removed afterwards, and OMP_NUM_THREADS and OPENBLAS_NUM_THREADS set to 1 unless
/// they are set already (one thread per worker: docs/ppo.md, section 4).  Standard output and error are inherited.  The first worker that
/// fails stops the others (SIGTERM, after `grace` SIGKILL).  SIGINT, SIGTERM, SIGHUP and SIGUSR1 are passed on; a second SIGINT or SIGTERM
/// stops all in the same way.  Returns the exit code for main: 0 if all succeeded, else the first failing worker's code (1 if it was
/// killed).  No worker outlives the call, or the calling process. Call it before other threads exist.  Throws RunError if no process can be
/// started, InputError for a number outside 1 to 64.
int spawn_workers(int num_workers, const std::vector<std::string>& arguments, std::chrono::milliseconds grace = std::chrono::seconds(5));

}  // namespace earshot
