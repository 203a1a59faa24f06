// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>

#include "earshot/env.h"
#include "python/src/interruptible.h"

namespace earshot::python {

/// A batch that is inside one call at a time.  A call that a signal ended goes on in the background; the next one waits for it.
class RunningBatch final : public BackgroundWork {
 public:
  explicit RunningBatch(VectorEnv made);
  /// In a forked child the batch stays: its threads are not there to be joined.
  ~RunningBatch();
  RunningBatch(const RunningBatch&) = delete;
  RunningBatch& operator=(const RunningBatch&) = delete;

  /// Begins a call, with the GIL.  @throws RunError where another thread is in one, or this one below a signal handler, or in a forked
  /// child.
  std::uint64_t enter(const char* function);
  void leave();
  /// The call of this number goes on without a caller.
  void abandon(std::uint64_t call);

  [[nodiscard]] bool is_at_rest() const override { return !env->works_in_background(); }

  std::unique_ptr<VectorEnv> env;

 private:
  const pid_t process_;
  std::mutex mutex_;
  std::condition_variable left_;
  std::uint64_t calls_ = 0;
  std::thread::id caller_;
  bool is_inside_ = false, is_abandoned_ = false;
};

/// As Python holds it.
struct BatchHandle {
  std::shared_ptr<RunningBatch> batch;
};

/// Ends a call with its life.
class Inside {
 public:
  explicit Inside(std::shared_ptr<RunningBatch> batch) : batch_(std::move(batch)) {}
  ~Inside() { batch_->leave(); }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;

 private:
  std::shared_ptr<RunningBatch> batch_;
};

/// A call of a batch, from construction to the end of its life or, where a signal ends its wait, of what goes on in the background.
class Entered {
 public:
  /// @throws as RunningBatch::enter().
  Entered(const BatchHandle& handle, const char* function)
      : batch_(handle.batch), number_(batch_->enter(function)), inside_(std::make_shared<const Inside>(batch_)) {}

  /// The result of `work(batch)`, as interruptible().
  template <class Work>
  auto call(Work work) const {
    try {
      return interruptible(
          [batch = batch_, inside = inside_, work = std::move(work)](const std::stop_token&) mutable { return work(*batch); });
    } catch (const nb::python_error&) {
      batch_->abandon(number_);
      throw;
    }
  }

 private:
  std::shared_ptr<RunningBatch> batch_;
  std::uint64_t number_;
  std::shared_ptr<const Inside> inside_;
};

/// The result of `work(batch)` in a call of its own.
template <class Work>
auto call(const BatchHandle& handle, const char* function, Work work) {
  return Entered(handle, function).call(std::move(work));
}

/// The result of `read(env)`, at once and with the GIL.
template <class Read>
auto look(const BatchHandle& handle, const char* function, const Read& read) {
  handle.batch->enter(function);
  const Inside inside(handle.batch);
  return read(std::as_const(*handle.batch->env));
}

}  // namespace earshot::python
