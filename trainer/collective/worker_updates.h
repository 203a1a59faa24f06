// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// One worker's report of its update; sent as raw bytes.
struct WorkerUpdate {
  double update_s, collect_s, rollout_steps, episodes, stopped, explained_variance, approx_kl, clip_fraction;
};

/// Of all workers, by rank.  A collective call.  Throws RunError naming a worker whose message has another size.
std::vector<WorkerUpdate> gather_worker_updates(Collective& collective, const WorkerUpdate& update);
/// Curve points under workers/, by the rank with which each worker began.  members: Collective::members.
void append_worker_values(std::vector<std::pair<std::string, double>>& values, const std::vector<int>& members,
                          const std::vector<WorkerUpdate>& of_all);

}  // namespace earshot
