// SPDX-License-Identifier: Apache-2.0
// The part of sim/base/process/isolated_call.h that runs in the started program.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <new>
#include <stdexcept>

#include "sim/base/errors.h"
#include "sim/base/process/child_program.h"
#include "sim/base/process/confinement.h"
#include "sim/base/process/isolated_call.h"

namespace earshot {
namespace {

constexpr int kOwnArguments = 4;  // name, calling process, memory, seconds

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
    memory_bytes = number_argument(argv[2]);
    take_on_limits(
        {.caller = static_cast<pid_t>(number_argument(argv[1])), .memory_bytes = memory_bytes, .cpu_seconds = number_argument(argv[3])});
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
