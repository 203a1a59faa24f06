// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>

namespace earshot {

struct ProcessLimits {
  pid_t caller = 0;                ///< with whose end this process ends
  std::uint64_t memory_bytes = 0;  ///< beyond what it has; 0: neither memory nor files are limited
  std::uint64_t cpu_seconds = 0;
};

/// Limits of this process for the rest of its life: CPU time, end with the caller, no core; with a bound on memory also that, and no file
/// can be written.
void take_on_limits(const ProcessLimits& limits);

/// Takes from this process, for the rest of its life, the right to open any file or folder, to connect by TCP and to signal processes
/// outside (Landlock, Linux 5.13 and later; connections from 6.7, signals from 6.12).  What is open stays open.  False where the kernel
/// cannot, or where the process has other threads, which would keep their rights.
bool give_up_files();

}  // namespace earshot
