// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>

namespace earshot {

struct ProcessLimits {
  pid_t caller = 0;                ///< the parent; the kernel ends this process with it
  std::uint64_t memory_bytes = 0;  ///< beyond what it has; 0: neither memory nor files are limited
  std::uint64_t cpu_seconds = 0;
};

/// Limits of this process for the rest of its life: CPU time, end with the caller, no core; with a bound on memory also that, and no file
/// can be written.  Reads /proc/self/statm, so it comes before give_up_files().  Throws RunError where that cannot be read.
void take_on_limits(const ProcessLimits& limits);

/// Removes the right to open files and folders, to connect by TCP and to signal other processes, for the rest of the process (Landlock,
/// Linux 5.13 and later; TCP from 6.7, signals from 6.12).  Open descriptors stay usable.  Returns false without Landlock, or if the
/// process has several threads, which would keep their rights.
bool give_up_files();

}  // namespace earshot
