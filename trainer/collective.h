#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "trainer/network_config.h"

namespace earshot {

/// Who this worker is.
struct WorkerIdentity {
  int rank = 0, world_size = 1;
};

/// What the workers of one run do together.  Calls are collective: every worker makes the same calls in the same order.  A peer that does
/// not answer in time, dies, or speaks another protocol is a RunError that names it; no call waits for ever.
class Collective {
 public:
  virtual ~Collective() = default;
  [[nodiscard]] virtual WorkerIdentity identity() const = 0;
  /// Replaces buffer by the sum over workers, each element summed in one fixed order: equal bits on every worker.  Same size everywhere.
  virtual void all_reduce_sum(std::span<float> buffer) = 0;
  virtual void all_reduce_sum(std::span<double> buffer) = 0;
  /// Rank 0's bytes reach all workers.
  virtual void broadcast(std::span<std::byte> buffer) = 0;
  virtual void barrier() = 0;
  /// The bytes of all workers at all workers, by rank.  For small messages.
  virtual std::vector<std::string> all_gather(const std::string& bytes) = 0;
};

/// One worker alone: every call is the identity.
std::unique_ptr<Collective> make_single_worker();

/// Ring over ZeroMQ (docs/ppo.md, section 6): reduce-scatter and all-gather in 1 MiB chunks, MessagePack control messages, version and run
/// id checked.
struct RingConfig {
  WorkerIdentity identity;
  std::string rendezvous;                    ///< "tcp://HOST:PORT" or "ipc:///path": rank 0 listens here
  std::string run_id;                        ///< an unknown peer with another id is refused
  std::chrono::milliseconds timeout{60000};  ///< of one collective call
  std::chrono::milliseconds heartbeat{500};  ///< a dead peer is noticed within about four of these
  NetworkConfig network = {};                ///< where to listen, and the keys of links that leave the host
};
std::unique_ptr<Collective> make_zmq_ring(const RingConfig& config);

}  // namespace earshot
