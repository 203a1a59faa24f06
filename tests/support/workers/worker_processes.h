// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "sim/base/temporary_folder.h"
#include "tests/support/wait_until.h"
#include "trainer/collective/collective.h"

namespace earshot {

/// Its path is short enough for the sockets of a group.
class PrivateTestFolder : public TemporaryFolder {
 public:
  PrivateTestFolder() : TemporaryFolder("/tmp", "earshot-test-") {}
};

/// An array that forked processes share with the test.
template <class T, std::size_t N>
class SharedArray {
 public:
  SharedArray() : values_(static_cast<T*>(::mmap(nullptr, N * sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0))) {}
  ~SharedArray() { ::munmap(const_cast<std::remove_volatile_t<T>*>(values_), N * sizeof(T)); }
  SharedArray(const SharedArray&) = delete;
  SharedArray& operator=(const SharedArray&) = delete;
  T& operator[](std::size_t i) { return values_[i]; }

 private:
  T* values_;
};

/// Real worker processes.  Fork them before the test has any thread.  Each is killed by an alarm rather than hang.
class WorkerProcesses {
 public:
  using Body = std::function<bool(int rank)>;  ///< true: as expected
  static constexpr unsigned kAlarm_s = 60;

  explicit WorkerProcesses(int count, const Body& body) {
    std::fflush(nullptr);
    for (int rank = 0; rank < count; ++rank) pids_.push_back(start(rank, body));
  }
  ~WorkerProcesses() {
    for (const pid_t pid : pids_)
      if (pid > 0) ::kill(pid, SIGKILL), ::waitpid(pid, nullptr, 0);
  }
  WorkerProcesses(const WorkerProcesses&) = delete;
  WorkerProcesses& operator=(const WorkerProcesses&) = delete;

  static pid_t start(int rank, const Body& body) {
    const pid_t pid = ::fork();
    if (pid != 0) return pid;
    ::alarm(kAlarm_s);
    int code = 1;
    try {
      code = body(rank) ? 0 : 1;
      if (code != 0) std::fprintf(stderr, "worker %d: not as expected\n", rank);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "worker %d: unexpected: %s\n", rank, error.what());
    }
    std::fflush(nullptr);
    ::_exit(code);
  }
  [[nodiscard]] pid_t pid(int rank) const { return pids_[static_cast<std::size_t>(rank)]; }
  /// Wait status of one worker.
  int wait(int rank) {
    int status = -1;
    pid_t& pid = pids_[static_cast<std::size_t>(rank)];
    while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    pid = 0;
    return status;
  }
  /// Until is_met() is true.  False after so many seconds, and as soon as one that was not waited for has ended.
  template <class Condition>
  [[nodiscard]] bool wait_until(const Condition& is_met, double seconds = kAlarm_s) const {
    return earshot::wait_until(is_met, seconds, pids_);
  }
  void expect_all_succeed() {
    for (int rank = 0; rank < static_cast<int>(pids_.size()); ++rank) EXPECT_EQ(wait(rank), 0) << "worker " << rank;
  }

 private:
  std::vector<pid_t> pids_;
};

inline RingConfig ring_in(const PrivateTestFolder& folder, int rank, int world_size) {
  RingConfig config;
  config.identity = {rank, world_size};
  config.rendezvous = "ipc://" + (folder.path() / "meet").string();
  config.run_id = "test-run";
  config.timeout = std::chrono::milliseconds(20000);
  return config;
}

}  // namespace earshot
