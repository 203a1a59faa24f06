// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "trainer/net/ring_config.h"

namespace earshot {

/// Libraries in this build.
struct BuiltTransports {
  bool mpi = false, gloo = false;
};
BuiltTransports built_transports();

struct ChosenTransport {
  Transport transport = Transport::zeromq;
  std::string reason;  ///< for the log
};

/// The transport of a world: network.collective, or where that is `auto` ZeroMQ up to kMaxMeshWorkers, beyond MPI where the launcher brings
/// it (PMIx of mpirun or srun), else Gloo, which meets at the rendezvous.  Throws InputError: more workers than
/// ZeroMQ connects, MPI without PMIx, a library that is not in this build, a key file that the library cannot use.
ChosenTransport choose_transport(const NetworkConfig& network, int world_size, bool has_pmix, BuiltTransports built = built_transports());

/// The word of the config for it.
std::string name_of(Transport transport);

}  // namespace earshot
