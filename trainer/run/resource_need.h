// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "sim/base/process/machine_limits.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Lower limit of a run's memory on one machine: fixed allocations, without scenes, sound and activations of the network.
struct ResourceNeed {
  int processes = 1;
  double program_bytes = 0, environment_bytes = 0, rollout_bytes = 0, learner_bytes = 0;  ///< of one worker

  [[nodiscard]] double worker_bytes() const { return program_bytes + environment_bytes + rollout_bytes + learner_bytes; }
  [[nodiscard]] double bytes() const { return processes * worker_bytes(); }
};

/// processes: workers on this machine.  config: validated.  Allocates nothing of the kind.
ResourceNeed resource_need(const RunConfig& config, int processes);

/// Throws InputError, one line with the numbers and the key that takes most, where the need is beyond the machine: more memory than it has,
/// or more than kWorkersPerCore processes for each of its cores.
void refuse_beyond_machine(const RunConfig& config, int processes, const MachineLimits& machine);

inline constexpr int kWorkersPerCore = 16;
/// Address space that a worker needs beside what it keeps: stacks of threads, arenas of the allocator, buffers of OpenBLAS.
inline constexpr std::uint64_t kWorkingBytes = 256u << 20;

}  // namespace earshot
