// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "trainer/collective/worker_exchange.h"

namespace earshot {

/// Workers connected by the Gloo of c10d, which libtorch brings, over TCP with two threads each.  They meet at the
/// rendezvous: over ipc in a file beside it, one per start, and at 127.0.0.1, over tcp in a store that rank 0 keeps there, at
/// network.interface or the way to rank 0.  Gloo has no heartbeats: a worker that ends is noticed at once by the others in
/// a call, one that hangs after RingConfig::timeout, and note_progress() does not prolong that.  Throws InputError: a build without Gloo,
/// links without keys that leave the host and are not network.insecure; WorldIncomplete where not all came in time;
/// RunError.
std::shared_ptr<WorkerExchange> join_gloo(const RingConfig& config);

}  // namespace earshot
