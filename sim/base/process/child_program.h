// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// How a program is started beside this one.
struct ChildSetup {
  std::filesystem::path program;
  std::vector<std::string> arguments = {};
  int descriptor = -1;                      ///< open here; number kAnswerDescriptor there
  std::filesystem::path folder = {};        ///< it works in; empty: the current one
  std::vector<std::string> variables = {};  ///< "NAME=VALUE" in the place of those of this process
  std::vector<std::string> passed = {};     ///< names of the variables of this process that it gets; empty: all
};

/// A program that runs, ended and waited for at the latest in the destructor.  Its input and outputs are /dev/null, no other descriptor but
/// ChildSetup::descriptor is open, its signals are as at the start of a program, and it is in a process group of its own: Ctrl-C goes to
/// this process only.
class ChildProgram {
 public:
  /// Throws RunError: it cannot be started.
  explicit ChildProgram(const ChildSetup& setup);
  ~ChildProgram() { end(); }
  ChildProgram(const ChildProgram&) = delete;
  ChildProgram& operator=(const ChildProgram&) = delete;

  /// Ends it and the programs of its group if it has not ended within `patience`.  Returns its status as waitpid gives it, nullopt if
  /// another waitpid took that.
  std::optional<int> end(std::chrono::milliseconds patience = {});

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

/// Where the program finds ChildSetup::descriptor.
inline constexpr int kAnswerDescriptor = 3;

/// A whole number among the program's arguments.  Throws InputError for any other text.
std::uint64_t number_argument(std::string_view digits);

}  // namespace earshot
