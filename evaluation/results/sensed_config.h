// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "envs/config/env_config.h"

namespace earshot {

/// What decides what an agent senses and how its world answers, by the keys of the env section with their values as text: sensors, head,
/// acoustics, loudness, noise, task, navmesh, limits and seed.  All but where files lie, threads and the sizes of caches, which change no
/// bit.  Files are named by their content: `hrtf` is the SHA-256 of the file, and so are microphones and patterns in observation.channels.
using SensedConfig = std::map<std::string, std::string>;

/// Throws InputError: the file of responses or one of microphones cannot be read.
SensedConfig sensed_config(const EnvConfig& env);

/// Whether a key of the env section has no effect on observations, so that machines may differ in it.
bool is_local_key(const std::string& key);

/// Throws InputError that names `where`, a policy or a result of others, or a benchmark for them: its sound has channels of a file, which
/// is not opened for them.  channels: observation.channels.
void refuse_channels_of_file(const std::string& channels, const std::string& where);

/// The env of these keys, without a file of responses.  Opens no file.  Throws InputError that names `where`: a key is unknown, its value
/// out of range, or its channels are of a file.
EnvConfig env_of_senses(const SensedConfig& senses, const std::string& where);

}  // namespace earshot
