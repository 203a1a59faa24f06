// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace earshot {

/// Memory and processors of this machine, or of the container in which the process runs.
struct MachineLimits {
  std::uint64_t memory_bytes = 0;   ///< of all processes together; 0: not known
  std::uint64_t process_bytes = 0;  ///< address space of one process; 0: no limit
  std::uint64_t mapped_bytes = 0;   ///< part of it that this process has mapped already, mainly libraries
  int cores = 1;                    ///< that this process may use
};

/// memory_bytes: the lesser of the machine's and that of the control group (v1 and v2).
MachineLimits machine_limits();

/// Whether this process can get so much more address space: libraries that find none may end it, or try for ever.  Takes microseconds.
bool can_map(std::uint64_t bytes);

}  // namespace earshot
