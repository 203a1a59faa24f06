// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// "section.key" -> value as YAML, for every leaf of a config's text.
std::map<std::string, std::string> flat_config(const std::string& yaml);

/// One key whose value differs, for messages: numbers rounded to six digits where that tells them apart, "(absent)" where a side does not
/// have the key.
struct ConfigChange {
  std::string key, before, now;
};
/// Keys of two flat configs that differ, in order.
std::vector<ConfigChange> config_changes(const std::map<std::string, std::string>& before, const std::map<std::string, std::string>& now);

/// Whether the key may differ between a run and the one it goes on from without being declared: it has no part in the bits of the weights
/// (docs/howto/training.md lists these keys).  `now`: the config of the resumed run; total_steps and max_minutes are bound where a decay or
/// guidance depends on them.
bool is_free_to_change(std::string_view key, const RunConfig& now);

/// Lines KEY=VALUE of the settings that all workers of one run must share: every key but those that say where files lie, how a worker
/// reaches the others and on how many threads it runs; the contents of the training set, of the held-out set, of a head's responses and of
/// microphone files, where they are used, by their hash. Throws InputError if that cannot be read.
std::string common_settings(const RunConfig& config);

/// The config of a checkpoint with overrides.  Throws InputError for the overrides env.acoustics.preset and seed: they set the defaults of
/// other keys, and a checkpoint holds all keys.
RunConfig parse_effective_config(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides);

/// The same of a checkpoint that was read.  A policy file may come from others: the folders that it names to write in are left out, unless
/// an override sets them.
RunConfig config_of_checkpoint(const CheckpointMetadata& checkpoint, const std::string& where, const std::vector<std::string>& overrides);

}  // namespace earshot
