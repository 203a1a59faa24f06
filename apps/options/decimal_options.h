// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>

namespace earshot {

/// Numbers of all options of the command and of those below it are read as in configs: decimal, whole numbers with an exponent where they
/// are whole (config_number.h).  Call it once all options are there.
void read_decimal_numbers(CLI::App& app);

}  // namespace earshot
