// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// What `earshot bench allreduce` asks of each of its workers.
struct AllReduceSpeedOptions {
  std::vector<std::size_t> bytes;  ///< sizes of the sums; multiples of 4
  int rounds = 5;
  double seconds = 0.2;  ///< of each size, way and round
  bool gloo = true;      ///< also by Gloo, where this build has it
  bool mpi = false;      ///< also by MPI: mpirun has started the workers
  /// Of one way between two workers, each of which becomes a host of its own (delayed_host.h); 0: all on this host.
  double delay_ms = 0;
};

struct AllReduceTime {
  /// shared_memory, ipc, tcp; gloo and mpi: the library's own all-reduce; gloo_ordered and mpi_ordered: with the bits of the ring.
  std::string way;
  std::size_t bytes = 0;
  bool bits_of_ring = false;  ///< of a sum of drawn addends, in up to 4,096 of its elements
  std::vector<double> ms;     ///< of a sum, mean of a round, on rank 0; one per round
};

/// Sums of floats by each way in turn (A B C D A B C D), each worker calling with the same options.  config: ipc rendezvous in a folder
/// that all workers share; the others' meeting points are made beside it.  With a delay the ways are tcp and Gloo, and the process stays in
/// its network namespace.  With more than kMaxMeshWorkers MPI alone.  The first sum of each size and way is checked.  Throws RunError.
std::vector<AllReduceTime> time_all_reduce(const AllReduceSpeedOptions& options, const RingConfig& config);

/// The ring over tcp on the loopback interface, at a port that is free on rank 0.  config: ipc rendezvous, as above.
std::unique_ptr<Collective> connect_over_loopback(const RingConfig& config);

}  // namespace earshot
