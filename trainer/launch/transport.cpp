// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/transport.h"

#include <fmt/format.h>

#include "sim/base/errors.h"

namespace earshot {

BuiltTransports built_transports() {
  BuiltTransports built;
#ifdef EARSHOT_MPI
  built.mpi = true;
#endif
#ifdef EARSHOT_GLOO
  built.gloo = true;
#endif
  return built;
}

std::string name_of(Transport transport) {
  switch (transport) {
    case Transport::automatic:
      return "auto";
    case Transport::zeromq:
      return "zeromq";
    case Transport::mpi:
      return "mpi";
    case Transport::gloo:
      return "gloo";
  }
  return "?";
}

ChosenTransport choose_transport(const NetworkConfig& network, int world_size, bool has_pmix, BuiltTransports built) {
  ChosenTransport chosen{network.collective, "network.collective is " + name_of(network.collective)};
  if (network.collective == Transport::automatic) {
    if (world_size <= kMaxMeshWorkers)
      return {Transport::zeromq, fmt::format("{} workers, ZeroMQ connects up to {}", world_size, kMaxMeshWorkers)};
    chosen.transport = has_pmix ? Transport::mpi : Transport::gloo;
    chosen.reason = fmt::format("{} workers are more than the {} of ZeroMQ, and the launcher {}", world_size, kMaxMeshWorkers,
                                has_pmix ? "brings PMIx" : "brings no PMIx");
  }
  const std::string setting = fmt::format("network.collective = {}", name_of(network.collective));
  const bool is_mpi = chosen.transport == Transport::mpi;
  if (chosen.transport == Transport::zeromq) {
    require(world_size <= kMaxMeshWorkers, "network.collective", "zeromq",
            fmt::format("connects up to {} workers, not {}: use mpi or gloo", kMaxMeshWorkers, world_size));
    return chosen;
  }
  if (is_mpi && !built.mpi)
    throw InputError(setting, "needs MPI, which is not part of this build", "install libopenmpi-dev and build again");
  if (!is_mpi && !built.gloo)
    throw InputError(setting, fmt::format("needs Gloo for {} workers, which is not part of this build", world_size),
                     "install libgloo-dev and build again, or start the workers with mpirun");
  if (is_mpi && !has_pmix)
    throw InputError(setting, "needs a launcher that brings PMIx", "start the workers with mpirun -n N, or with srun --mpi=pmix");
  if (!network.curve_key_file.empty())
    throw InputError(
        setting,
        fmt::format("connects {} workers by {}, which has no keys for network.curve_key_file", world_size, name_of(chosen.transport)),
        "leave the key out, and use --insecure-network on a network that you trust");
  return chosen;
}

}  // namespace earshot
