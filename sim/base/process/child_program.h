// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// How a program is started beside this one.
struct ChildSetup {
  std::filesystem::path program;
  std::vector<std::string> arguments = {};
  int descriptor = -1;                      ///< open here; number kAnswerDescriptor there
  std::filesystem::path folder = {};        ///< it works in; empty: the current one
  std::vector<std::string> variables = {};  ///< "NAME=VALUE" in the place of those of this process
};

/// A program that runs, ended and waited for at the latest in the destructor.  Its input and outputs are /dev/null, its signals are as at
/// the start of a program, and it is in a process group of its own: Ctrl-C goes to this process only.
class ChildProgram {
 public:
  /// Throws RunError: it cannot be started.
  explicit ChildProgram(const ChildSetup& setup);
  ~ChildProgram() { end(); }
  ChildProgram(const ChildProgram&) = delete;
  ChildProgram& operator=(const ChildProgram&) = delete;

  /// Ends it if it has not ended; its status as waitpid gives it, nullopt if another waitpid took that.
  std::optional<int> end();

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

/// Where the program finds ChildSetup::descriptor.
inline constexpr int kAnswerDescriptor = 3;

}  // namespace earshot
