// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/wait.h>

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"
#include "tests/support/files/test_paths.h"

/// Calls of tests/unit/sim/base/process/isolated_child.cpp.
namespace earshot::isolated_calls {

inline const std::filesystem::path program = isolated_child_program();
inline constexpr IsolationLimits kSmall{.wall_time = std::chrono::milliseconds(20'000), .memory_bytes = std::uint64_t{256} << 20};

/// The answer of the program to these arguments.
inline std::string call(const std::vector<std::string>& arguments, const IsolationLimits& limits = kSmall) {
  return call_isolated(program, arguments, "house.obj", limits);
}

/// The message of the refusal, or that there was an answer.
inline std::string refusal(const std::vector<std::string>& arguments, const IsolationLimits& limits = kSmall) {
  try {
    const std::string answer = call(arguments, limits);
    return "answered " + std::to_string(answer.size()) + " bytes";
  } catch (const InputError& error) {
    return error.what();
  }
}

/// Whether this process has any, ended or not.
inline bool has_children() { return !(::waitpid(-1, nullptr, WNOHANG) < 0 && errno == ECHILD); }

}  // namespace earshot::isolated_calls
