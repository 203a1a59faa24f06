// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>
#include <string>
#include <vector>

#include "earshot/config.h"
#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"
#include "sim/audio/head/listener_layout.h"

namespace earshot::api {

/// A text that changes with the files of a layout, by their bytes, and with a head filter, by place, size and times of its file.
std::string state_of_files(const ListenerLayout& layout, const std::string& hrtf);

/// Now, by the clock that stamps files.
timespec file_time_now();

/// See VectorEnv::input_files().  since: file_time_now() before the batch was made.
std::vector<InputFile> input_files_of(const EnvConfig& config, const earshot::EpisodeSet& set, timespec since);

}  // namespace earshot::api
