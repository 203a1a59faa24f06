// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "envs/config/env_config.h"

namespace earshot {

/// What decides what an agent senses and how its world answers, by the keys of the env section with their values as text: sensors, head,
/// acoustics, loudness, noise, task, navmesh, limits and seed.  All but where files lie, threads and the sizes of caches, which change no
/// bit.  `hrtf` is the SHA-256 of the file that is named.
using SensedConfig = std::map<std::string, std::string>;

/// Throws InputError: the file of responses cannot be read.
SensedConfig sensed_config(const EnvConfig& env);

/// Whether a key of the env section has no effect on observations, so that machines may differ in it.
bool is_local_key(const std::string& key);

/// The env of these keys, without a file of responses.  Throws InputError that names `where`: a key is unknown or its value out of range.
EnvConfig env_of_senses(const SensedConfig& senses, const std::string& where);

}  // namespace earshot
