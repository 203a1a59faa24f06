// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sim/scene/habitat/json_fields.h"

namespace earshot {

/// A path in a JSON file, relative to `base`, within the folder `root` of the data set.  Throws InputError naming the file and the key for
/// a path that is empty, absolute or leads out of `root` as it is written; symbolic links within are followed.
std::filesystem::path path_within(const std::filesystem::path& root, const std::filesystem::path& base, const std::string& text,
                                  const JsonFields& fields, const char* key);

/// Files that a path with the wildcards * and ? names: those that match, and of folders that match the files in them (not below), as far
/// as their names end in `end` (in any case).  Sorted.  A folder that is not there has no files.  Throws InputError where a part of the
/// pattern matches over 100,000 paths.
std::vector<std::filesystem::path> find_files(const std::filesystem::path& pattern, const std::string& end);

/// Whether `name` ends in `end`, without case.
bool ends_with_folded(const std::string& name, std::string_view end);

}  // namespace earshot
