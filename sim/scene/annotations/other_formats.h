// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace earshot {

/// Throws InputError for a file of a data set that is no scene by itself, with what it is and what to give instead: .navmesh, .scn,
/// .house, .semantic.txt, info_semantic.json, .urdf, and the parts of Habitat's data sets (.stage_config.json and the like).  Returns for
/// all else.
void refuse_other_formats(const std::filesystem::path& path);

}  // namespace earshot
