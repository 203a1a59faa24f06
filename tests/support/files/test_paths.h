// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace earshot {

// Absolute paths of this checkout and build.  Only test_paths.cpp is compiled with them, so that a compiler cache can share all other
// objects between checkouts.

std::filesystem::path source_dir();              ///< root of the source tree
std::filesystem::path earshot_program();         ///< the command line program; for tests that depend on its target
std::filesystem::path isolated_child_program();  ///< tests/unit/sim/base/process/isolated_child.cpp; for tests that depend on its target

}  // namespace earshot
