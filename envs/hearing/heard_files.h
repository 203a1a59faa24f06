// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>

#include "envs/config/env_config.h"
#include "envs/task/episode.h"

namespace earshot {

/// Hashes of files by their names in a config or an episode.
using FileHashes = std::map<std::string, std::uint64_t>;

/// The files that decide what agents hear, besides scenes.
struct HeardFiles {
  FileHashes sounds;  ///< of the episodes
  FileHashes ears;    ///< config.hrtf, and the microphone files that config.observation.channels names
};

/// None where no sensor hears, and none of generated sounds and heads.  Reads each file once.  Throws InputError if one is not there.
HeardFiles heard_files_of(const EnvConfig& config, std::span<const Episode> episodes);

/// Of one episode: its sounds, and the ears.
FileHashes heard_in(const Episode& episode, const HeardFiles& files);

/// Of all episodes.
FileHashes heard_in_all(const HeardFiles& files);

/// Hash of the bytes of a regular file of up to 4 GiB.  Throws InputError for anything else.
std::uint64_t hash_of_file(const std::filesystem::path& path);

}  // namespace earshot
