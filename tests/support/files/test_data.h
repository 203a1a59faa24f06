// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <filesystem>

#include "tests/support/files/test_paths.h"

namespace earshot {

/// Folder of the test data that no package has: $EARSHOT_DATA, else shared/data beside the sources.  It may be absent.
inline std::filesystem::path data_folder() {
  if (const char* named = std::getenv("EARSHOT_DATA")) return named;
  return source_dir() / "../shared/data";
}

/// Skips the test if `file` of the test data is absent.  scripts/summarize_tests.sh counts the skips that begin so.
#define SKIP_WITHOUT_DATA(file)                         \
  if (!std::filesystem::exists(data_folder() / (file))) \
  GTEST_SKIP() << "no test data: " << (data_folder() / (file)).string() << " (set EARSHOT_DATA)"

}  // namespace earshot
