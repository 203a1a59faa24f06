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
  places.are_moved = true;
  return places;
}

std::optional<EnvOrigin> origin_of_env(int place, int saved_workers, int saved_envs) {
  if (place >= saved_workers * saved_envs) return std::nullopt;
  return EnvOrigin{place / saved_envs, place % saved_envs};
}

std::string moved_envs_text(int saved_workers, int saved_envs, int workers, int envs) {
  const int before = saved_workers * saved_envs, now = workers * envs;
  std::string text = fmt::format("{} workers x {} environments instead of {} x {}: {} environments continue in their order", workers, envs,
                                 saved_workers, saved_envs, std::min(before, now));
  if (now > before) text += fmt::format(", {} start with new episodes", now - before);
  if (now < before) text += fmt::format(", the last {} are dropped", before - now);
  return text;
}

}  // namespace earshot
