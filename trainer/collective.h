#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "trainer/network_config.h"

namespace earshot {

/// Who this worker is.
struct WorkerIdentity {
  int rank = 0, world_size = 1;
};

/// Workers were lost and those that are left have agreed to go on without them, or a connection was broken and has been opened anew.  What
/// the open call was to give is void, on all workers that are left; some of them may have completed it.
class MembershipChange : public RunError {
 public:
  explicit MembershipChange(std::vector<int> lost_workers);
  [[nodiscard]] const std::vector<int>& lost() const { return lost_; }  ///< ranks at the start; empty where a connection was opened anew

 private:
  std::vector<int> lost_;
};

/// This worker is no part of the run any more: the others have gone on without it, or may have.
class LeftOut : public RunError {
 public:
  using RunError::RunError;
};

/// What the workers of one run do together.  Calls are collective: every worker makes the same calls in the same order.  A peer that does
/// not answer in time, dies, or speaks another protocol is a RunError that names it; no call waits for ever.  With OnLoss::go_on a peer
/// that is lost is a MembershipChange instead, and identity() is another afterwards.
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

  /// Ranks at the start of the workers that are left, by rank.
  [[nodiscard]] virtual std::vector<int> members() const;
  /// Whether calls may throw MembershipChange.
  [[nodiscard]] virtual bool survives_loss() const { return false; }
  /// Not collective: the work between two calls calls this wherever it has got on (an env step, a minibatch), so that the others can tell a
  /// worker that is slow from one that hangs.  Costs a look at the clock.
  virtual void note_progress() {}
  /// Not collective: how many other workers have begun the next call, which has to be one that reaches all at once (no sum of 64 KiB or
  /// more).
  [[nodiscard]] virtual int num_waiting() { return 0; }
};

/// One worker alone: every call is the identity.
std::unique_ptr<Collective> make_single_worker();

/// Ring over ZeroMQ (docs/ppo.md, section 6): reduce-scatter and all-gather in 1 MiB chunks, MessagePack control messages, version and run
/// id checked.
struct RingConfig {
  WorkerIdentity identity;
  std::string rendezvous;                    ///< "tcp://HOST:PORT" or "ipc:///path": rank 0 listens here
  std::string run_id;                        ///< an unknown peer with another id is refused
  std::chrono::milliseconds timeout{60000};  ///< of one collective call in which no peer makes progress
  std::chrono::milliseconds heartbeat{500};  ///< a dead peer is noticed within about four of these
  NetworkConfig network = {};                ///< where to listen, and the keys of links that leave the host
};
std::unique_ptr<Collective> make_zmq_ring(const RingConfig& config);

}  // namespace earshot
