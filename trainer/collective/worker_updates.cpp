// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/worker_updates.h"

#include <fmt/format.h>

#include <cstring>
#include <limits>

#include "sim/base/errors.h"
#include "trainer/net/ring_config.h"

namespace earshot {

std::vector<WorkerUpdate> gather_worker_updates(Collective& collective, const WorkerUpdate& own_update) {
  std::string bytes(sizeof(own_update), '\0');
  std::memcpy(bytes.data(), &own_update, sizeof(own_update));
  std::vector<WorkerUpdate> all;
  for (const std::string& of_one : collective.all_gather(bytes)) {
    WorkerUpdate& update = all.emplace_back();
    if (of_one.size() != sizeof(update))
      throw RunError(worker_name(collective.members()[all.size() - 1]), "reports an update of the wrong size");
    std::memcpy(&update, of_one.data(), sizeof(update));
  }
  return all;
}

void append_worker_values(std::vector<std::pair<std::string, double>>& values, const std::vector<int>& members,
                          const std::vector<WorkerUpdate>& of_all) {
  for (std::size_t rank = 0; rank < of_all.size(); ++rank) {
    const WorkerUpdate& rank_update = of_all[rank];
    const double stopped = rank_update.episodes > 0 ? rank_update.stopped / rank_update.episodes : std::numeric_limits<double>::quiet_NaN();
    const auto add = [&](const char* name, double value) { values.emplace_back(fmt::format("workers/{}/{}", members[rank], name), value); };
    add("update_s", rank_update.update_s);
    add("collect_s", rank_update.collect_s);
    add("rollout_steps", rank_update.rollout_steps);
    add("stopped", stopped);
    add("timeout", 1 - stopped);
    add("explained_variance", rank_update.explained_variance);
    add("approx_kl", rank_update.approx_kl);
    add("clip_fraction", rank_update.clip_fraction);
  }
}

}  // namespace earshot
