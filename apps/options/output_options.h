// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>

namespace earshot {

/// Kinds of paths, as help shows them behind an option: add_option(...)->type_name(kOutputFile).  Program checks every output before the
/// command runs (check_outputs), against all other outputs, and against every file and folder that the command line names.
inline constexpr const char* kOutputFile = "OUTFILE";
inline constexpr const char* kOutputFolder = "OUTDIR";
inline constexpr const char* kWholeFolder = "DIR";  ///< read with all that lies below it

/// Throws InputError as check_outputs does, for the command that was parsed, whichever below `app` it is.
void check_outputs_of(const CLI::App& app);

}  // namespace earshot
