// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "trainer/net/ring_config.h"

namespace earshot {

/// Workers were lost and those that are left have agreed to go on without them, others have joined, or a connection was broken and has been
/// opened anew.  The result of the open call is void on all workers; some may have completed it.
class MembershipChange : public RunError {
 public:
  explicit MembershipChange(std::vector<int> lost_workers, std::vector<int> joined_workers = {});
  /// Ranks at the start; both empty where a connection was opened anew.
  [[nodiscard]] const std::vector<int>& lost() const { return lost_; }
  [[nodiscard]] const std::vector<int>& joined() const { return joined_; }

 private:
  std::vector<int> lost_, joined_;
};

/// Communication between the workers of one run.  Calls are collective: every worker makes the same calls in the same order.  A peer that
/// does
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
  /// Not collective: number of other workers that have begun the next call, which has to be one that reaches all at once (no sum of 64 KiB
  /// or
  /// more).
  [[nodiscard]] virtual int num_waiting() { return 0; }

  /// Workers that come to a run under way (docs/howto/hosts.md, section 4).  Not collective: what they are told before they prepare their
  /// part; the same on all workers, as any may come to be the one that tells them.
  virtual void brief(const std::string& /*text*/) {}
  /// Not collective: whether some are ready.  On one worker at most.
  [[nodiscard]] virtual bool has_joiners() { return false; }
  /// Lets those join that are ready: then a MembershipChange; returns where none is.
  virtual void admit() {}
  /// The bytes of worker `from` reach the workers `to`; the others get an empty text.  The same from and to everywhere.
  virtual std::string hand_over(int from, const std::vector<int>& to, const std::string& bytes);

  /// Of a worker that joins.  Before enter(), identity() is that of the start of the run, and there are no collective calls.
  [[nodiscard]] virtual bool is_joining() const { return false; }
  [[nodiscard]] virtual std::string briefing() const { return {}; }
  /// Returns once the others have admitted this worker: for them the MembershipChange.
  virtual void enter() {}
  /// This worker has all that the others have.  An error of its own ends the run from now on; before, the others only lose it again.
  virtual void confirm_join() {}
};

/// One worker alone: every call is the identity.
std::unique_ptr<Collective> make_single_worker();

/// Ring over ZeroMQ (docs/explanation/ppo.md, section 6): reduce-scatter and all-gather in 1 MiB chunks, MessagePack control messages,
/// version and run id checked.  Up to kMaxMeshWorkers; for more, or by choice, worker_exchange.h.
std::unique_ptr<Collective> make_zmq_ring(const RingConfig& config);

/// A worker that joins a run under way in place of a lost one: same run id, world size and meeting point as at the start of the
/// run. Asks for the members, and may be refused.  Throws InputError (refused: another protocol, engine, setting or run, a rank outside the
/// world), RunError (no worker answers, the key is not allowed).
std::unique_ptr<Collective> make_joining_worker(const RingConfig& config);

}  // namespace earshot
