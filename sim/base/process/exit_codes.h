// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>
#include <string>

#include "sim/base/errors.h"

namespace earshot {

/// How every command of earshot ends: the one table.  `earshot --help` shows it, docs/reference/exit_codes.md explains it.
enum ExitCode : int {
  kExitDone = 0,
  kExitFailed = 1,         ///< a run that started well and then failed: RunError
  kExitBadInput = 2,       ///< usage, config or file: InputError
  kExitLostWorld = 3,      ///< a worker that lost the others, or a run that lost a worker: may be started again
  kExitInterrupted = 130,  ///< by SIGINT, with a checkpoint written
  kExitAskedToEnd = 143    ///< by SIGTERM, SIGHUP or SIGUSR1, with a checkpoint written
};

/// This process has lost the others of its run, or one of them that the run does not go on without, through no fault of its own: the run
/// may be started again (kExitLostWorld).
class WorldLost : public RunError {
 public:
  using RunError::RunError;
};

/// Of a run that a signal has ended in order; 0, no signal: done.
constexpr int exit_code_after(int signal) { return signal == 0 ? kExitDone : signal == SIGINT ? kExitInterrupted : kExitAskedToEnd; }
/// Whether a process that ended so was asked to, and has left what it was to leave.
constexpr bool is_orderly_end(int code) { return code == kExitDone || code == kExitInterrupted || code == kExitAskedToEnd; }

/// The table in words, for help.
inline std::string exit_code_table() {
  return "Exit codes: 0 done; 1 failed; 2 bad usage or bad input; 3 lost its workers or its run, and may be started again (train: with\n"
         "--resume or --elastic); 130 interrupted (SIGINT) and 143 asked to end (SIGTERM, SIGHUP, SIGUSR1), with a checkpoint written.";
}

}  // namespace earshot
