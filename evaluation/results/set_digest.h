// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "envs/episodes/episode_set.h"

namespace earshot {

/// SHA-256 that binds all that a set names.  Of one file with its episodes, whose scenes and sounds are generated: of the bytes of the
/// file, as `sha256sum` prints it.  Otherwise of a text with the canonical episodes, in whichever files they are, and the SHA-256 of every
/// file of a scene and of a sound under the name that the episodes give it.  scene_root, sound_root: as EnvConfig's.  Reads every file
/// once. Throws InputError: the set or a file is missing, or which files a scene reads cannot be told.
std::string digest_of_set(const std::filesystem::path& file, const std::string& scene_root, const std::string& sound_root);

/// Of the files of scenes and sounds alone; empty where all are generated.
std::string digest_of_content(const EpisodeSet& set, const std::string& scene_root, const std::string& sound_root);

}  // namespace earshot
