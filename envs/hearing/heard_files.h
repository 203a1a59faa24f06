// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "envs/config/env_config.h"
#include "envs/task/episode.h"

namespace earshot {

/// Hashes of files by their names in a config or an episode.
using HeardFiles = std::map<std::string, std::uint64_t>;

/// The files that decide what agents hear, besides scenes: of all sounds that the episodes play, config.hrtf, and the microphone files that
/// config.observation.channels names.  None where no sensor hears, and none of generated sounds and heads.  Reads each file once.  Throws
/// InputError if one is not there.
HeardFiles heard_files_of(const EnvConfig& config, std::span<const Episode> episodes);

}  // namespace earshot
