// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/confinement.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <functional>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// The status of a process that does this and returns its exit code.
int status_of(const std::function<int()>& body) {
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) {
    take_on_limits({.caller = parent, .memory_bytes = std::uint64_t{256} << 20, .cpu_seconds = 1});
    ::_exit(body());
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return status;
}

bool can_map(std::size_t bytes) { return ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED; }

TEST(Confinement, MemoryFilesAndTimeAreLimited) {
  const int memory = status_of([] {
    const bool small = can_map(std::size_t{64} << 20), large = can_map(std::size_t{512} << 20);
    return small && !large ? 7 : 1;
  });
  EXPECT_TRUE(WIFEXITED(memory) && WEXITSTATUS(memory) == 7) << memory;
  const int file = status_of([] {
    std::signal(SIGXFSZ, SIG_IGN);
    const int descriptor = ::open("/tmp", O_TMPFILE | O_RDWR, 0600);
    return descriptor >= 0 && ::write(descriptor, "x", 1) < 0 && errno == EFBIG ? 7 : 1;
  });
  EXPECT_TRUE(WIFEXITED(file) && WEXITSTATUS(file) == 7) << file;
  const int time = status_of([] {
    for (volatile int i = 0;;) i = i + 1;
    return 0;
  });
  EXPECT_TRUE(WIFSIGNALED(time) && WTERMSIG(time) == SIGXCPU) << time;
}

// As a process of a policy does it: a limit that was not measured would be one on all that is mapped.
TEST(Confinement, WhatIsThereBeforeDoesNotCount) {
  void* before = ::mmap(nullptr, std::size_t{1} << 30, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  ASSERT_NE(before, MAP_FAILED);
  const int status = status_of([] {
    static_cast<void>(give_up_files());
    return can_map(std::size_t{64} << 20) && !can_map(std::size_t{512} << 20) ? 7 : 1;
  });
  ::munmap(before, std::size_t{1} << 30);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 7) << status;
}

// Where files are out of reach first, nothing tells what is mapped: no limit is made up.
TEST(Confinement, LimitsThatCannotBeMeasuredAreRefused) {
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) {
    if (!give_up_files()) ::_exit(77);
    try {
      take_on_limits({.caller = parent, .memory_bytes = std::uint64_t{256} << 20, .cpu_seconds = 1});
    } catch (const RunError&) {
      ::_exit(7);
    }
    ::_exit(1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 77) GTEST_SKIP() << "this kernel has no Landlock";
  EXPECT_EQ(WEXITSTATUS(status), 7);
}

TEST(Confinement, FilesAreOutOfReachButWhatIsOpen) {
  const int status = status_of([] {
    std::array<int, 2> ends{};
    const int open_before = ::open("/etc/passwd", O_RDONLY);
    if (::pipe(ends.data()) != 0) return 1;
    if (!give_up_files()) return 77;
    char byte = 0;
    const auto is_denied = [](const char* path, int flags) { return ::open(path, flags, 0600) < 0 && errno == EACCES; };
    if (!is_denied("/etc/passwd", O_RDONLY) || !is_denied("/", O_RDONLY | O_DIRECTORY) || !is_denied("/proc/self/maps", O_RDONLY)) return 2;
    if (!is_denied("/tmp/earshot_confinement", O_CREAT | O_WRONLY) || ::unlink("/tmp") == 0) return 3;
    if (::execl("/bin/true", "/bin/true", nullptr) == 0 || errno != EACCES) return 4;
    if (::read(open_before, &byte, 1) != 1) return 5;
    if (::write(ends[1], &byte, 1) != 1 || ::read(ends[0], &byte, 1) != 1) return 6;
    return 7;
  });
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 77) GTEST_SKIP() << "this kernel has no Landlock";
  EXPECT_EQ(WEXITSTATUS(status), 7);
  EXPECT_FALSE(std::filesystem::exists("/tmp/earshot_confinement"));
}

}  // namespace
}  // namespace earshot
