// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/machine_limits.h"

#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <thread>

namespace earshot {
namespace {

/// The number in a file; 0 where there is none ("max", or no such file).
std::uint64_t number_in(const std::string& file) {
  std::uint64_t number = 0;
  std::ifstream(file) >> number;
  return number;
}

/// The control group of this process under v2: "0::/user.slice/...".
std::string control_group() {
  std::ifstream file("/proc/self/cgroup");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("0::")) return line.substr(3);
  return "/";
}

}  // namespace

MachineLimits machine_limits() {
  MachineLimits limits;
  limits.cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const auto at_most = [&](std::uint64_t bytes) {
    if (bytes > 0 && (limits.memory_bytes == 0 || bytes < limits.memory_bytes)) limits.memory_bytes = bytes;
  };
  const long pages = ::sysconf(_SC_PHYS_PAGES), page = ::sysconf(_SC_PAGE_SIZE);
  if (pages > 0 && page > 0) at_most(static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page));
  at_most(number_in("/sys/fs/cgroup/memory/memory.limit_in_bytes"));
  for (std::string group = control_group(); !group.empty(); group.erase(group.rfind('/')))
    at_most(number_in("/sys/fs/cgroup" + (group == "/" ? "" : group) + "/memory.max"));
  limits.mapped_bytes = number_in("/proc/self/statm") * static_cast<std::uint64_t>(std::max(0L, page));
  rlimit space{};
  if (::getrlimit(RLIMIT_AS, &space) == 0 && space.rlim_cur != RLIM_INFINITY) limits.process_bytes = space.rlim_cur;
  return limits;
}

bool can_map(std::uint64_t bytes) {
  void* memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return false;
  ::munmap(memory, bytes);
  return true;
}

}  // namespace earshot
