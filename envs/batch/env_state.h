// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "envs/hearing/heard_files.h"

namespace earshot {

/// Where one env is: which episode, and the actions since its start.  Everything else is a function of these.
struct EnvCursor {
  bool active = false;
  bool ended = false;        ///< its episode, and no other has begun: the last action ended it
  bool is_void = false;      ///< its episode was quarantined and no other has begun: restored, the env begins its next one
  std::uint64_t seed = 0;    ///< of the draws of its episodes
  std::uint32_t stream = 0;  ///< which sequence of that seed: the global env id, or 0 where the env has a seed of its own
  std::uint64_t episode_index = 0;
  int episode_count = 0;
  std::vector<std::int8_t> actions;                   ///< of the first agent, until it ended
  std::vector<std::vector<std::int8_t>> others = {};  ///< of the further ones
  std::uint64_t scene = 0;                            ///< Scene::hash(); 0: without an episode, or in files of before
};

/// State of a batch, with what it must be restored into.
struct EnvState {
  std::uint64_t set_hash = 0, seed = 0;
  int first_env = 0, total_envs = 0;
  bool started = false;
  std::vector<EnvCursor> envs;
  FileHashes heard = {};  ///< none in files of before
};

/// JSON with a version and a checksum.
std::string encode(const EnvState& state);
/// Throws InputError: not JSON, wrong version, checksum, missing or wrong fields.
EnvState decode_env_state(std::string_view text);

/// The envs of BatchedEnv::save_state() one by one: snapshots for BatchedEnv::restore(env, snapshot).  Throws InputError as
/// decode_env_state(), and for a batch in which no episode has started.
std::vector<std::string> snapshots_of(std::string_view batch_state);

}  // namespace earshot
