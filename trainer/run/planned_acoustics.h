// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "trainer/run/run_config.h"

namespace earshot {

/// Acoustic settings that meet env.accuracy for the episodes of data.train.file, kept as a small YAML file in the folder of the run, so
/// that workers,
/// evaluations and resumed runs hear the same.  The file's name holds a hash of target, episodes, the rest of env.acoustics, task and
/// navmesh, so that another config never reads it; a scene file that has changed under the same name is not noticed.

/// File of the choice for this config in `folder` (the run's `out`).  Throws InputError for a missing or damaged episode set.
std::filesystem::path acoustics_plan_file(const RunConfig& config, const std::filesystem::path& folder);

/// The config with env.accuracy replaced by the choice that is kept in the first of `folders` that has it; nullopt if none has.  A config
/// without env.accuracy comes back as it is.  Throws InputError for a damaged file.
std::optional<RunConfig> with_kept_acoustics(const RunConfig& config, const std::vector<std::filesystem::path>& folders);

/// Chooses (plan_env_accuracy: seconds to minutes, with progress on stderr), keeps the choice in config.out and prints it.
RunConfig plan_acoustics(const RunConfig& config);

}  // namespace earshot
