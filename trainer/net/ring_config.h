// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

/// Reaction to the loss of a worker: end the run, or go on without it.
enum class OnLoss { stop, go_on };

/// What connects the workers: sockets of ZeroMQ, or the libraries MPI and Gloo; automatic: choose_transport (trainer/launch/transport.h).
enum class Transport { automatic, zeromq, mpi, gloo };

/// How workers on several hosts reach each other: section `network` of a run config (docs/howto/hosts.md).  Without any key, workers meet
/// on one host only.
struct NetworkConfig {
  Transport collective = Transport::automatic;
  std::string interface;       ///< where this worker listens: name (eth0) or address; empty: where the way to rank 0 begins
  std::string port_range;      ///< "FIRST-LAST"; empty: any free port, and 20000-29999 for a meeting point whose launcher names none
  std::string curve_key_file;  ///< this worker's CURVE keys (`earshot keys`), mode 0600
  std::string allow_list;      ///< file of public keys that may take part, one per line; empty: only the own one
  std::string meeting_key;     ///< public key of rank 0; empty: the own one, as all workers have the same file
  bool shared_memory = true;   ///< workers of one host add up gradients in memory that they share
  bool insecure = false;       ///< links that leave the host may go without keys
  OnLoss on_loss = OnLoss::stop;
  int restarts = 0;                 ///< restarts of lost workers by `earshot train --workers N`, in one run
  double progress_timeout_s = 600;  ///< a worker that others wait for and that gets on in nothing for so long is lost
};

struct PortRange {
  int first = 0, last = 0;  ///< both 0: any
};

/// Throws InputError for an invalid port range.
PortRange ports_of(const NetworkConfig& config);

void read(ConfigReader& reader, NetworkConfig& config);
/// Throws InputError: a port range that is none, keys that are missing for what is asked, keys together with insecure.  Opens no file.
void validate(const NetworkConfig& config);

/// Workers of one run.  Over ZeroMQ each has a connection to each other, up to kMaxMeshWorkers.
inline constexpr int kMaxMeshWorkers = 64, kMaxWorkers = 1024;
/// Throws InputError for less than one worker or more than kMaxWorkers, and for more than kMaxMeshWorkers that are to go on without a lost
/// one.
void validate_world(int num_workers, OnLoss on_loss);

/// Identity of this worker.
struct WorkerIdentity {
  int rank = 0, world_size = 1;

  /// The neighbours in a ring of all workers.
  [[nodiscard]] int right() const { return (rank + 1) % world_size; }
  [[nodiscard]] int left() const { return (rank + world_size - 1) % world_size; }
};

/// How errors and log lines name a worker.
[[nodiscard]] std::string worker_name(int rank);

/// This worker is no part of the run any more: the others have gone on without it, or may have.
class LeftOut : public RunError {
 public:
  using RunError::RunError;
};

/// The workers of a start did not all find each other in time, or not the same number of them.
class WorldIncomplete : public RunError {
 public:
  using RunError::RunError;
};

/// Rendezvous and timeouts of the workers of one run.
struct RingConfig {
  WorkerIdentity identity;
  std::string rendezvous;                    ///< "tcp://HOST:PORT" or "ipc:///path": rank 0 listens here
  std::string run_id;                        ///< an unknown peer with another id is refused
  std::string start_id = {};                 ///< the launcher's name of this start, where run_id is that of all starts; empty: none
  std::chrono::milliseconds timeout{60000};  ///< of one collective call in which no peer makes progress
  std::chrono::milliseconds heartbeat{500};  ///< a dead peer is noticed within about four of these
  NetworkConfig network = {};                ///< where to listen, and the keys of links that leave the host
  /// Properties that a joining worker must share with the run: its program, and lines KEY=VALUE.
  std::string engine = {}, settings = {};
  std::uint32_t incarnation = 0;  ///< 0: one of the first world; else names one start of a worker that joins

  [[nodiscard]] bool survives_loss() const { return network.on_loss == OnLoss::go_on; }
};

}  // namespace earshot
