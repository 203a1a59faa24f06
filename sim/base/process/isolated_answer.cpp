// SPDX-License-Identifier: Apache-2.0
// The part of sim/base/process/isolated_call.h that runs in the started program.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <new>
#include <stdexcept>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"

namespace earshot {
namespace {

constexpr int kOwnArguments = 4;  // name, calling process, memory, seconds

std::uint64_t to_number(const char* text) {
  std::uint64_t number = 0;
  const std::string_view digits = text;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (error != std::errc() || end != digits.data() + digits.size()) throw InputError(digits, "is not a number", "");
  return number;
}

void lower_limit(int resource, rlim_t value) {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0) return;
  limit.rlim_cur = std::min(limit.rlim_max, value);
  limit.rlim_max = limit.rlim_cur;
  static_cast<void>(::setrlimit(static_cast<__rlimit_resource_t>(resource), &limit));
}

/// Address space and writable pages now (proc(5), statm), as sanitizers hold terabytes of both.
struct Footprint {
  std::uint64_t address_bytes = 0, data_bytes = 0;
};
Footprint footprint() {
  unsigned long long size = 0, data = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "re")) {
    if (std::fscanf(file, "%llu %*u %*u %*u %*u %llu", &size, &data) != 2) size = data = 0;
    std::fclose(file);
  }
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {size * page, data * page};
}

/// Sets the limits: CPU time, end with the caller, no core; of memory and files as IsolationLimits has it.
void take_on_limits(pid_t asking, std::uint64_t memory_bytes, std::uint64_t seconds) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != asking) ::_exit(0);  // it ended before that call
  ::prctl(PR_SET_DUMPABLE, 0);
  lower_limit(RLIMIT_CPU, seconds);
  lower_limit(RLIMIT_CORE, 0);
  if (memory_bytes == IsolationLimits::kUnlimited) return;
  const Footprint now = footprint();
  lower_limit(RLIMIT_AS, now.address_bytes + memory_bytes);
  lower_limit(RLIMIT_DATA, now.data_bytes + memory_bytes);
  lower_limit(RLIMIT_FSIZE, 0);
}

void write_all(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(kAnswerDescriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return;
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace

int answer_isolated(int argc, char** argv, const std::function<std::string(const std::vector<std::string>& arguments)>& work) {
  if (argc < kOwnArguments || ::fcntl(kAnswerDescriptor, F_GETFD) < 0) {
    std::fprintf(stderr, "%s: internal program of earshot; do not run it directly\n", argc > 0 ? argv[0] : "reader");
    return 2;
  }
  AnswerKind kind = AnswerKind::refusal;
  std::string bytes;
  std::uint64_t memory_bytes = 0;
  try {
    memory_bytes = to_number(argv[2]);
    take_on_limits(static_cast<pid_t>(to_number(argv[1])), memory_bytes, to_number(argv[3]));
    bytes = work({argv + kOwnArguments, argv + argc});
    kind = AnswerKind::answer;
  } catch (const std::bad_alloc&) {
    bytes = fmt::format("needs more than {} MB of memory to read; the file may be damaged", memory_bytes >> 20);
  } catch (const std::exception& error) {
    bytes = error.what();
  }
  write_all(answer_header(kind, bytes));
  write_all(bytes);
  ::_exit(0);  // without destructors: those of a library on damaged data may crash
}

}  // namespace earshot
