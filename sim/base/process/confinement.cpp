// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/confinement.h"

#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"

namespace earshot {
namespace {

void lower_limit(int resource, rlim_t value, rlim_t grace = 0) {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0) return;
  limit.rlim_cur = std::min(limit.rlim_max, value);
  limit.rlim_max = std::min(limit.rlim_max, limit.rlim_cur + grace);
  static_cast<void>(::setrlimit(static_cast<__rlimit_resource_t>(resource), &limit));
}

/// Address space and writable pages now (proc(5), statm), as sanitizers hold terabytes of both.
struct Footprint {
  std::uint64_t address_bytes = 0, data_bytes = 0;
};
Footprint footprint() {
  constexpr const char* path = "/proc/self/statm";
  unsigned long long size = 0, data = 0;
  std::FILE* file = std::fopen(path, "re");
  const bool is_read = file != nullptr && std::fscanf(file, "%llu %*u %*u %*u %*u %llu", &size, &data) == 2;
  if (file != nullptr) std::fclose(file);
  if (!is_read) throw RunError(path, "cannot be read, so memory cannot be limited");
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {size * page, data * page};
}

/// struct landlock_ruleset_attr of linux/landlock.h, which older headers have in part.
struct LandlockRules {
  std::uint64_t files = 0, network = 0, scopes = 0;
};

/// Every right that a kernel of this version of the interface knows, and the bytes of the struct that it reads.
std::size_t fill_rules(long version, LandlockRules& rules) {
  const int file_rights = version >= 5 ? 16 : version >= 3 ? 15 : version >= 2 ? 14 : 13;
  rules.files = (std::uint64_t{1} << file_rights) - 1;
  if (version >= 4) rules.network = 3;  // bind and connect
  if (version >= 6) rules.scopes = 3;   // abstract sockets and signals
  return version >= 6 ? 24 : version >= 4 ? 16 : 8;
}

bool is_single_threaded() {
  std::error_code error;
  const std::filesystem::directory_iterator tasks("/proc/self/task", error);
  return !error && std::distance(begin(tasks), end(tasks)) == 1;
}

}  // namespace

void take_on_limits(const ProcessLimits& limits) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != limits.caller) ::_exit(0);  // it ended before that call
  ::prctl(PR_SET_DUMPABLE, 0);
  lower_limit(RLIMIT_CPU, limits.cpu_seconds, 1);  // SIGXCPU tells the limit from other ends
  lower_limit(RLIMIT_CORE, 0);
  if (limits.memory_bytes == 0) return;
  const Footprint now = footprint();
  lower_limit(RLIMIT_AS, now.address_bytes + limits.memory_bytes);
  lower_limit(RLIMIT_DATA, now.data_bytes + limits.memory_bytes);
  lower_limit(RLIMIT_FSIZE, 0);
}

bool give_up_files() {
#ifdef SYS_landlock_create_ruleset
  constexpr unsigned ask_version = 1;
  const long version = ::syscall(SYS_landlock_create_ruleset, nullptr, 0, ask_version);
  if (version < 1 || !is_single_threaded()) return false;
  LandlockRules rules;
  const std::size_t bytes = fill_rules(version, rules);
  const Descriptor ruleset(static_cast<int>(::syscall(SYS_landlock_create_ruleset, &rules, bytes, 0)));
  if (ruleset.get() < 0 || ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return false;
  return ::syscall(SYS_landlock_restrict_self, ruleset.get(), 0) == 0;
#else
  return false;
#endif
}

}  // namespace earshot
