// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

/// The commit that this program was built from, with "-dirty" if files differed from it; "unknown" outside a repository.
std::string engine_commit();
/// CMake's build type: Release, Debug.
std::string build_type();

}  // namespace earshot
