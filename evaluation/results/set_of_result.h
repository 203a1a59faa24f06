// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "evaluation/results/result.h"

namespace earshot {

/// The episode set of a result that others may have written, which does not decide alone what is read: a file under one of `folders`, links
/// followed.  It is the file that the result names where that lies in one of them, else the file of that path or of that name below one.
/// where: the result's file, for messages.  Throws InputError: no such file there, or what load_episode_set refuses.
EpisodeSet set_of_result(const EvaluationResult& result, const std::string& where, const std::vector<std::filesystem::path>& folders);

/// For results that are only shown: the current folder and that of the result.
std::vector<std::filesystem::path> folders_near(const std::string& result_file);

}  // namespace earshot
