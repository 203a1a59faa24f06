// SPDX-License-Identifier: Apache-2.0
#include "sim/base/engine_commit.h"

#include "build_commit.inc"

namespace earshot {

std::string engine_commit() { return kCommit; }

std::string build_type() { return kBuildType; }

}  // namespace earshot
