// SPDX-License-Identifier: Apache-2.0
// Forks and the end of the process wait for what the engine does.
#include "python/src/running_calls.h"

#include <pthread.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <system_error>
#include <thread>

#include "earshot/errors.h"

namespace earshot::python {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto kBetweenLooks = 2ms;  // at background work
constexpr auto kPatienceOfForks = 30s;
constexpr auto kPatienceWithWorkers = 100ms;

/// Of the process.  Never destroyed: a call may outlive main().
struct Calls {
  std::mutex mutex;  ///< held by no thread that waits for the GIL
  std::condition_variable changed;
  int running = 0;
  int forks = 0;           ///< that are being prepared: no other thread begins a call
  bool is_broken = false;  ///< forked amid work
  bool works_at_fork = false;
  std::set<const BackgroundWork*> background;
  std::unique_ptr<nb::python_error> interrupt;  ///< of a signal handler before a fork, for the caller of that
  nb::object forking_frame;                     ///< of that caller; none: it is no Python

  [[nodiscard]] bool is_at_rest() const {
    return running == 0 && std::ranges::all_of(background, [](const BackgroundWork* work) { return work->is_at_rest(); });
  }
};

/// Of this thread, among Calls::forks.
thread_local int forks_of_this_thread = 0;

Calls& calls() {
  static auto* const all = new Calls;
  return *all;
}

/// Whether all is at rest within `patience`.  With the GIL, which others have meanwhile.
/// @throws nb::python_error where a signal handler of Python raises.
bool wait_until_at_rest(std::chrono::milliseconds patience) {
  Calls& all = calls();
  const auto due = Clock::now() + patience;
  for (;;) {
    {
      const nb::gil_scoped_release released;
      std::unique_lock lock(all.mutex);
      const auto next_check = std::min(due, Clock::now() + kBetweenSignalChecks);
      for (;;) {
        if (all.is_at_rest()) return true;
        if (Clock::now() >= next_check) break;
        all.changed.wait_for(lock, kBetweenLooks);
      }
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (Clock::now() >= due) return false;
  }
}

/// Whether all other threads of the process sleep, so that none of them holds a lock for a moment.
bool others_sleep() {
  const auto own_thread = std::to_string(syscall(SYS_gettid));
  std::error_code gone;
  for (std::filesystem::directory_iterator thread("/proc/self/task", gone), end; !gone && thread != end; thread.increment(gone)) {
    if (thread->path().filename() == own_thread) continue;
    std::string line;
    std::ifstream stat(thread->path() / "stat");
    std::getline(stat, line);
    const auto name_end = line.rfind(')');
    if (name_end != std::string::npos && name_end + 2 < line.size() && line[name_end + 2] == 'R') return false;
  }
  return true;
}

/// No other thread begins a call from here until after the fork.  Python reports and forgets what a function before a fork raises: an
/// exception of a signal handler ends the wait and is raised after the fork.
void before_fork() {
  Calls& all = calls();
  ++forks_of_this_thread;
  {
    const std::lock_guard lock(all.mutex);
    ++all.forks;
  }
  try {
    wait_until_at_rest(kPatienceOfForks);
  } catch (const nb::python_error& error) {
    all.interrupt = std::make_unique<nb::python_error>(error);
    all.forking_frame = nb::borrow(reinterpret_cast<PyObject*>(PyEval_GetFrame()));
    return;
  }
  // Threads of the engine look for work a while after a call, and take locks as they do.
  for (const auto due = Clock::now() + kPatienceWithWorkers; Clock::now() < due && !others_sleep();) std::this_thread::sleep_for(1ms);
}

void tell_interrupt();

/// In the caller of the fork: functions that Python calls after a fork may hold locks, and what they raise is lost.
int raise_interrupt(void* /*unused*/) {
  Calls& all = calls();
  if (!all.interrupt) return 0;
  if (all.forking_frame.is_valid() && all.forking_frame.ptr() != reinterpret_cast<PyObject*>(PyEval_GetFrame())) {
    tell_interrupt();
    return 0;
  }
  all.forking_frame = nb::object();
  const std::unique_ptr<nb::python_error> interrupt = std::move(all.interrupt);
  interrupt->restore();
  return -1;
}

void tell_interrupt() {
  if (calls().interrupt) Py_AddPendingCall(&raise_interrupt, nullptr);
}

void after_fork_in_parent() {
  Calls& all = calls();
  if (forks_of_this_thread > 0) {
    --forks_of_this_thread;
    const std::lock_guard lock(all.mutex);
    --all.forks;
  }
  all.changed.notify_all();
  tell_interrupt();
}

// Around any fork of the process, Python's or not.

void lock_at_fork() {
  Calls& all = calls();
  all.mutex.lock();
  all.works_at_fork = !all.is_at_rest();
}

void unlock_in_parent() { calls().mutex.unlock(); }

/// Work of threads that are not here never ends.
void unlock_in_child() {
  Calls& all = calls();
  all.is_broken = all.is_broken || all.works_at_fork;
  all.running = all.forks = forks_of_this_thread = 0;
  all.background.clear();
  all.mutex.unlock();
}

}  // namespace

RunningCall::RunningCall() {
  Calls& all = calls();
  for (;;) {
    {
      const std::lock_guard lock(all.mutex);
      if (all.forks == 0 || forks_of_this_thread > 0) {
        ++all.running;
        return;
      }
    }
    {
      const nb::gil_scoped_release released;
      std::unique_lock lock(all.mutex);
      all.changed.wait_for(lock, kBetweenSignalChecks, [&] { return all.forks == 0; });
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  }
}

RunningCall::~RunningCall() {
  const std::lock_guard lock(calls().mutex);
  if (--calls().running == 0) calls().changed.notify_all();
}

void BackgroundWork::begin_watch() {
  const std::lock_guard lock(calls().mutex);
  calls().background.insert(this);
}

void BackgroundWork::end_watch() {
  const std::lock_guard lock(calls().mutex);
  calls().background.erase(this);
}

bool is_main_thread() { return getpid() == static_cast<pid_t>(syscall(SYS_gettid)); }

void require_usable_process() {
  if (calls().is_broken)
    throw RunError("earshot", "this process was forked while another thread was computing; fork earlier, or start it by spawn");
}

void bind_forks(nb::module_& m) {
  m.def("before_fork", &before_fork);
  m.def("after_fork_in_parent", &after_fork_in_parent);
  m.def("after_fork_in_child", &tell_interrupt);
  m.def("wait_until_idle",
        [](double patience_s) { return wait_until_at_rest(std::chrono::milliseconds(static_cast<long>(patience_s * 1000))); });
  if (pthread_atfork(&lock_at_fork, &unlock_in_parent, &unlock_in_child) != 0)
    throw RunError("earshot", "cannot watch forks of this process; free some memory");
}

}  // namespace earshot::python
