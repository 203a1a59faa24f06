// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>

namespace earshot {

/// A line on stderr of a command that goes on.
inline void print_warning(const std::string& warning) { fmt::print(stderr, "warning: {}\n", warning); }

}  // namespace earshot
