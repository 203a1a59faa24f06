// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/replay.h"

#include <array>

#include "envs/batch/env_state.h"

namespace earshot {

std::uint64_t replay_cold(const SoakRecord& record, const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set, int total_envs) {
  EnvConfig alone = config;
  alone.threads = 1;
  alone.prefetch = false;
  BatchedEnv env(alone, set, make_scene_cache(alone), 1, record.env, total_envs);
  // The start of an episode is the state of an env that has not acted in it yet.
  EnvState start{.set_hash = set->hash, .seed = alone.seed, .first_env = record.env, .total_envs = total_envs, .started = true, .envs = {}};
  start.envs.push_back({.active = true,
                        .seed = alone.seed,
                        .stream = static_cast<std::uint32_t>(record.env),
                        .episode_index = record.episode_index,
                        .episode_count = record.episode_count,
                        .actions = {}});
  env.restore(encode(start));

  EpisodeHash hash;
  SoakRowCopy copy;
  hash.begin();
  hash.add(copy.take(env, 0, false));
  for (const std::int8_t action : record.actions) {
    env.step(std::array<std::int32_t, 1>{action});
    const bool ended = env.terminated()[0] != 0 || env.truncated()[0] != 0;
    hash.add(copy.take(env, 0, ended));
    if (ended) break;
  }
  return hash.value();
}

}  // namespace earshot
