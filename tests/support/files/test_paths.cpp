// SPDX-License-Identifier: Apache-2.0
#include "tests/support/files/test_paths.h"

namespace earshot {

std::filesystem::path source_dir() { return EARSHOT_SOURCE_DIR; }
std::filesystem::path earshot_program() { return EARSHOT_BINARY; }
std::filesystem::path isolated_child_program() { return EARSHOT_ISOLATED_CHILD; }

}  // namespace earshot
