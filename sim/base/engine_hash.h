// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

/// XXH3 of the running program, 16 hexadecimal digits: results of different builds can be told apart.  Reads the whole program file.
std::string engine_hash();

}  // namespace earshot
