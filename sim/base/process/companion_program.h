// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace earshot {

/// A program that is built and installed with this one: beside the library that holds this code (the extension of the Python package),
/// beside the running program, one folder up, in ../libexec/earshot (programs installed under the same prefix), there as seen from an
/// installed libRLRAudioPropagation.so, or where the build's own prefix puts it.  variable: an environment variable that may name the file
/// instead; null: none.  Throws RunError, which names the folder of the program and the installed place, if it is in none.
std::filesystem::path companion_program(const std::string& name, const char* variable = nullptr);

}  // namespace earshot
