// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "trainer/collective/worker_exchange.h"

namespace earshot {

/// The workers that mpirun, or srun with PMIx, has started, connected by MPI (MPI_THREAD_SERIALIZED: one thread at a time makes its calls).
/// Once per process.  A process that has lost the others, or ends by an error, leaves without MPI_Finalize, so that the launcher ends the
/// job.  Throws InputError: a build without MPI, a launcher that brings none, another rank or world than the config's, several hosts
/// without network.insecure, as MPI knows no keys; RunError.
std::shared_ptr<WorkerExchange> join_mpi(const RingConfig& config);

}  // namespace earshot
