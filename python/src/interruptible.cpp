// SPDX-License-Identifier: Apache-2.0
#include "python/src/interruptible.h"

#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "earshot/errors.h"

namespace earshot::python {
namespace {

/// One call: done once `work` has returned, whoever still waits.
class Job {
 public:
  explicit Job(std::function<void()> work) : work_(std::move(work)), running_(std::in_place) {}

  void run() {
    try {
      work_();
    } catch (...) {
      error_ = std::current_exception();
    }
    work_ = nullptr;   // what it owns goes before its end is told
    is_done_ = true;   // before the end of the call, for which a fork waits
    running_.reset();  // before the caller goes on, who may fork
    const std::lock_guard lock(mutex_);
    is_told_ = true;
    ended_.notify_all();
  }
  /// Whether it ends within the time between two looks at signals.
  bool wait() {
    std::unique_lock lock(mutex_);
    return ended_.wait_for(lock, kBetweenSignalChecks, [this] { return is_told_; });
  }
  /// Whether there is a result.  Takes no lock.
  [[nodiscard]] bool is_done() const { return is_done_; }
  [[nodiscard]] const std::exception_ptr& error() const { return error_; }

 private:
  std::function<void()> work_;
  std::optional<RunningCall> running_;
  std::mutex mutex_;
  std::condition_variable ended_;
  std::atomic<bool> is_done_{false};
  bool is_told_ = false;
  std::exception_ptr error_;
};

/// A thread that runs one job after the other, and ends after its last one with this object or later.
class Helper {
 public:
  Helper() {
    std::thread([state = state_] { state->work(); }).detach();
  }
  ~Helper() {
    if (!is_here()) return;
    const std::lock_guard lock(state_->mutex);
    state_->leaves = true;
    state_->wakes.notify_all();
  }
  Helper(const Helper&) = delete;
  Helper& operator=(const Helper&) = delete;

  /// Whether its thread is in this process: a fork does not copy it.
  [[nodiscard]] bool is_here() const { return process_ == getpid(); }
  /// The job before must be done.
  void start(std::shared_ptr<Job> job) {
    const std::lock_guard lock(state_->mutex);
    state_->job = std::move(job);
    state_->wakes.notify_all();
  }

 private:
  struct State {
    std::mutex mutex;
    std::condition_variable wakes;
    std::shared_ptr<Job> job;
    bool leaves = false;

    void work() {
      for (std::unique_lock lock(mutex);;) {
        wakes.wait(lock, [&] { return job || leaves; });
        if (!job) return;
        const std::shared_ptr<Job> next = std::move(job);
        lock.unlock();
        next->run();
        lock.lock();
      }
    }
  };

  const pid_t process_ = getpid();
  const std::shared_ptr<State> state_ = std::make_shared<State>();
};

/// The helper that has no job, of the main thread.  Never destroyed: its thread may outlive main().
std::unique_ptr<Helper>& idle_helper() {
  static auto* const idle = new std::unique_ptr<Helper>;
  return *idle;
}

}  // namespace

void run_on_helper(std::function<void()> work, std::stop_source stop) {
  const auto job = std::make_shared<Job>(std::move(work));
  std::unique_ptr<Helper> helper = std::move(idle_helper());  // a call of a signal handler meanwhile finds none
  if (!helper || !helper->is_here()) helper = std::make_unique<Helper>();
  helper->start(job);
  for (;;) {
    {
      const nb::gil_scoped_release released;
      if (job->wait()) break;
    }
    const bool is_interrupted = PyErr_CheckSignals() != 0;
    if (helper->is_here()) {
      if (!is_interrupted) continue;
      stop.request_stop();
    }
    // A handler may have forked: what the thread of the parent held is held for ever here.
    if (is_interrupted) throw nb::python_error();
    if (job->is_done()) break;
    throw RunError("earshot", "this process was forked by a signal handler amid a call; fork elsewhere, or start it by spawn");
  }
  if (helper->is_here() && !idle_helper()) idle_helper() = std::move(helper);
  if (job->error()) std::rethrow_exception(job->error());
}

}  // namespace earshot::python
