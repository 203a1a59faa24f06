// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "bench/soak/watch.h"

namespace earshot {

/// Hash of the observations of an episode that is run again alone, in fresh environments with a fresh scene cache: equal to record.hash
/// unless something outlived an episode that must not.  total_envs: of the batch that made the record.
std::uint64_t replay_cold(const SoakRecord& record, const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set, int total_envs);

}  // namespace earshot
