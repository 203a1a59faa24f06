// SPDX-License-Identifier: Apache-2.0
#include "python/src/interruptible.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>

#include "earshot/errors.h"

namespace earshot::python {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenLooks = 50ms;  // at signals
constexpr auto kPatienceOfForks = 30s;
constexpr auto kPatienceWithWorkers = 100ms;

/// One call: done once `work` has returned, whoever still waits.
struct Job {
  std::function<void()> work;
  std::mutex mutex;
  std::condition_variable ended;
  bool is_done = false;
  std::exception_ptr error;

  void run() {
    try {
      const RunningCall running;
      work();
    } catch (...) {
      error = std::current_exception();
    }
    work = nullptr;  // what it owns goes before its end is told
    const std::lock_guard lock(mutex);
    is_done = true;
    ended.notify_all();
  }
};

/// A thread that runs one job after the other, and ends where its job was abandoned or it is told to.
class Helper {
 public:
  Helper() : thread_([this] { work(); }) {}
  ~Helper() {
    {
      const std::lock_guard lock(mutex_);
      leaves_ = true;
    }
    wakes_.notify_all();
    thread_.join();
  }
  Helper(const Helper&) = delete;
  Helper& operator=(const Helper&) = delete;

  void start(std::shared_ptr<Job> job) {
    {
      const std::lock_guard lock(mutex_);
      job_ = std::move(job);
    }
    wakes_.notify_all();
  }
  /// Without a wait: the thread ends after its job, with the object.
  static void leave(std::unique_ptr<Helper> helper) {
    std::thread([last = std::move(helper)]() mutable { last.reset(); }).detach();
  }

 private:
  void work() {
    for (std::unique_lock lock(mutex_);;) {
      wakes_.wait(lock, [&] { return job_ || leaves_; });
      if (!job_) return;
      const std::shared_ptr<Job> job = std::move(job_);
      lock.unlock();
      job->run();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable wakes_;
  std::shared_ptr<Job> job_;
  bool leaves_ = false;
  std::thread thread_;  // last: it uses the rest
};

/// Of the process.  Never destroyed: a job may outlive main().
struct Calls {
  std::mutex mutex;
  std::condition_variable fewer;
  int running = 0;
  bool is_broken = false;          ///< forked amid calls
  std::unique_ptr<Helper> helper;  ///< of the main thread
};

Calls& calls() {
  static auto* const all = new Calls;
  return *all;
}

bool wait_until_none_runs(std::chrono::milliseconds patience) {
  Calls& all = calls();
  std::unique_lock lock(all.mutex);
  return all.fewer.wait_for(lock, patience, [&] { return all.running == 0; });
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

/// With the GIL, which keeps other threads from beginning calls until after the fork.
void before_fork() {
  if (wait_until_none_runs(kPatienceOfForks))
    calls().helper.reset();  // its thread is not in the child
  else
    Helper::leave(std::move(calls().helper));
  // Threads of the engine look for work a while after a call, and take locks as they do.
  for (const auto due = std::chrono::steady_clock::now() + kPatienceWithWorkers; std::chrono::steady_clock::now() < due && !others_sleep();)
    std::this_thread::sleep_for(1ms);
  calls().mutex.lock();
}

void after_fork_in_parent() { calls().mutex.unlock(); }

void after_fork_in_child() {
  Calls& all = calls();
  all.is_broken = all.is_broken || all.running != 0;
  all.running = 0;
  all.mutex.unlock();
}

}  // namespace

RunningCall::RunningCall() {
  const std::lock_guard lock(calls().mutex);
  ++calls().running;
}

RunningCall::~RunningCall() {
  const std::lock_guard lock(calls().mutex);
  if (--calls().running == 0) calls().fewer.notify_all();
}

bool is_main_thread() { return getpid() == static_cast<pid_t>(syscall(SYS_gettid)); }

void require_usable_process() {
  if (calls().is_broken)
    throw RunError("earshot", "this process was forked while another thread was computing; fork earlier, or start it by spawn");
}

void run_on_helper(std::function<void()> work, std::stop_source stop) {
  std::unique_ptr<Helper>& helper = calls().helper;
  if (!helper) helper = std::make_unique<Helper>();
  const auto job = std::make_shared<Job>();
  job->work = std::move(work);
  helper->start(job);
  for (;;) {
    {
      const nb::gil_scoped_release released;
      std::unique_lock lock(job->mutex);
      if (job->ended.wait_for(lock, kBetweenLooks, [&] { return job->is_done; })) break;
    }
    if (PyErr_CheckSignals() == 0) continue;
    stop.request_stop();
    Helper::leave(std::move(helper));
    throw nb::python_error();
  }
  if (job->error) std::rethrow_exception(job->error);
}

void bind_forks(nb::module_& m) {
  m.def("before_fork", &before_fork);
  m.def("after_fork_in_parent", &after_fork_in_parent);
  m.def("after_fork_in_child", &after_fork_in_child);
  m.def("wait_until_idle", [](double patience_s) {
    const nb::gil_scoped_release released;
    return wait_until_none_runs(std::chrono::milliseconds(static_cast<long>(patience_s * 1000)));
  });
}

}  // namespace earshot::python
