// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/env_places.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "sim/base/errors.h"

namespace earshot {

EnvPlaces env_places_of(const std::optional<Checkpoint>& resumed, int world_size, const std::vector<std::string>& changes) {
  EnvPlaces places;
  if (resumed && resumed->world_size == world_size && !resumed->members.empty()) return {resumed->members, resumed->started_workers, false};
  places.members.resize(static_cast<std::size_t>(world_size));
  std::iota(places.members.begin(), places.members.end(), 0);
  places.started_workers = world_size;
  if (!resumed || resumed->world_size == world_size) return places;
  if (std::ranges::find(changes, "workers") == changes.end())
    throw InputError(fmt::format("checkpoint of update {}", resumed->update),
                     fmt::format("belongs to a run with {} workers, but this run has {}", resumed->world_size, world_size),
                     "resume with the same number of workers, or allow the change with --change workers");
  places.begin_anew = true;
  return places;
}

}  // namespace earshot
