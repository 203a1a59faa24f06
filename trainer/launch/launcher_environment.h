// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "trainer/launch/meeting_folder.h"
#include "trainer/launch/run_key.h"
#include "trainer/net/ring_config.h"

namespace earshot {

/// Environment variables by name.
using Variables = std::map<std::string, std::string>;

/// Rank, world size and hosts that a launcher states for this process.
struct LaunchedWorker {
  std::string launcher;          ///< "EARSHOT_RANK" (our own spawn, or set by hand), "torchrun", "Open MPI", "MPICH", "Slurm", "Kubernetes"
  RingConfig ring;               ///< identity, rendezvous, run id, start id; not validated
  bool has_pmix = false;         ///< MPI can find the other ranks: mpirun, or srun --mpi=pmix
  std::string transport_reason;  ///< why ring.network.collective is what it is, from worker_from_environment
  std::filesystem::path folder = {};                ///< of an ipc rendezvous on one host; empty where none is needed
  std::shared_ptr<MeetingFolder> made_folder = {};  ///< it, once worker_from_environment has made it
  std::shared_ptr<RunKey> run_key = {};             ///< of a rendezvous on the loopback interface, from worker_from_environment
};

/// Rank, world size, meeting point and run id from the first of these tables that is there (docs/howto/hosts.md has the variables):
///   1 EARSHOT_RANK, _WORLD_SIZE, _RENDEZVOUS and _RUN_ID, all four;
///   2 torchrun; 3 Open MPI; 4 MPICH's Hydra; 5 a Slurm step; 6 an indexed job of Kubernetes.
/// Inner launchers come before outer ones: mpirun within a Slurm job starts ranks of mpirun.  EARSHOT_RENDEZVOUS and EARSHOT_RUN_ID
/// complete or replace what tables 2 to 6 say of these two; EARSHOT_WORLD_SIZE and EARSHOT_RANK complete them and must agree with them.
/// Where all ranks are on one host they meet in a folder of the user's own, elsewhere at tcp://HOST OF RANK 0:PORT.
/// nullopt: no table, or one with a single process, which starts like a program without a launcher.  Throws InputError, one line: a table
/// with a part missing, a value that is not a number, a rank outside the world, two sources that differ.
/// first_port, last_port: where the port of a meeting point may lie whose launcher names only a host.  collective: under PMIx MPI, and
/// `automatic` with more than kMaxMeshWorkers, does without a meeting point.
std::optional<LaunchedWorker> worker_from(const Variables& variables, int first_port = 20000, int last_port = 29999,
                                          Transport collective = Transport::zeromq);

/// The variables of this process that worker_from reads.
Variables launcher_variables();

}  // namespace earshot
