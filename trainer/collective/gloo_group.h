// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "trainer/collective/collective.h"

namespace earshot {

/// Whether this build has Gloo (libgloo-dev was there).
bool has_gloo();

/// Collective calls by the Gloo of c10d, which libtorch brings: the yardstick of `earshot bench allreduce`.  Workers of one host, which
/// meet by a file in a folder that they share and talk over TCP with two threads each, as c10d does by default, at `address` of this host.
/// Sums are added in Gloo's own order: equal bits on every worker, other ones than the ring's.  No keys, and a worker that hangs is noticed
/// by the timeout alone, which is why training does not use it.  Throws RunError, InputError in a build without Gloo.
std::unique_ptr<Collective> make_gloo_group(WorkerIdentity identity, const std::string& meeting_file, std::chrono::milliseconds timeout,
                                            const std::string& address = "127.0.0.1");

}  // namespace earshot
