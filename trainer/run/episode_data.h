// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "envs/episodes/episode_set.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Generates the episodes of `data`, writes its file with the keys they were made from, and reports progress.  Returns the set.
EpisodeSet generate_data(const DataConfig& data, const EnvConfig& env);

/// Inputs of a generated set: the version of the generator, the keys of the data section but `file`, and those of the environment
/// that decide where agents can stand and how far they walk.  Names as in a run config, the data section's as "data.KEY".
std::map<std::string, std::string> generator_keys(const DataConfig& data, const EnvConfig& env);

/// Throws InputError, one line with the first key that differs, its two values and `remedy`, if `set` was made from other keys than
/// `expected`, or does not say from which.  An empty `expected` stands for a config that does not generate: any set will do.
void check_generator(const EpisodeSet& set, const std::map<std::string, std::string>& expected, const std::string& file,
                     const std::string& remedy);

/// generator_keys, or nothing where data.scenes is empty: then the file is a set from elsewhere, used as it is.
std::map<std::string, std::string> expected_generator(const DataConfig& data, const EnvConfig& env);

}  // namespace earshot
