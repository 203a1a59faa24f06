#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/collective.h"

namespace earshot {

/// Rank, world size and meeting point of this process, from the environment variables EARSHOT_RANK, EARSHOT_WORLD_SIZE, EARSHOT_RENDEZVOUS and
/// EARSHOT_RUN_ID that spawn_workers sets (or a launcher does).  nullopt if none is set; InputError if they contradict each other.
std::optional<RingConfig> worker_from_environment();

/// Starts `num_workers` copies of this program with the same arguments and waits for all.  The first one that fails stops the others (SIGTERM, then SIGKILL
/// after a grace time).  Standard output and error are inherited.  SIGINT and SIGTERM are passed on.  Returns the exit code for main:
/// 0 if all succeeded, else the first failing worker's code (1 if it was killed).  No process outlives the call.
int spawn_workers(int num_workers, const std::vector<std::string>& arguments);

}  // namespace earshot
