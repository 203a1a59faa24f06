#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "sim/base/errors.h"
#include "trainer/net/network_config.h"

namespace earshot {

/// Workers of one run.  Up to kMaxMeshWorkers each has a connection to each other; beyond, each has its neighbours in a tree.
inline constexpr int kMaxMeshWorkers = 64, kMaxWorkers = 1024;
/// Throws InputError for less than one worker or more than kMaxWorkers, and for more than kMaxMeshWorkers that are to go on without a lost
/// one.
void validate_world(int num_workers, OnLoss on_loss);

/// Who this worker is.
struct WorkerIdentity {
  int rank = 0, world_size = 1;
};

/// This worker is no part of the run any more: the others have gone on without it, or may have.
class LeftOut : public RunError {
 public:
  using RunError::RunError;
};

/// How the workers of one run find each other and how long they wait for each other.
struct RingConfig {
  WorkerIdentity identity;
  std::string rendezvous;                    ///< "tcp://HOST:PORT" or "ipc:///path": rank 0 listens here
  std::string run_id;                        ///< an unknown peer with another id is refused
  std::chrono::milliseconds timeout{60000};  ///< of one collective call in which no peer makes progress
  std::chrono::milliseconds heartbeat{500};  ///< a dead peer is noticed within about four of these
  NetworkConfig network = {};                ///< where to listen, and the keys of links that leave the host
  /// What a worker that joins must have in common with the run: its program, and lines KEY=VALUE.
  std::string engine = {}, settings = {};
  std::uint32_t incarnation = 0;  ///< 0: one of the first world; else names one start of a worker that joins
};

}  // namespace earshot
