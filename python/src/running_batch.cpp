// SPDX-License-Identifier: Apache-2.0
#include "python/src/running_batch.h"

#include <unistd.h>

#include "earshot/errors.h"

namespace earshot::python {

RunningBatch::RunningBatch(VectorEnv made) : env(std::make_unique<VectorEnv>(std::move(made))), process_(getpid()) { begin_watch(); }

RunningBatch::~RunningBatch() {
  end_watch();
  if (process_ != getpid()) static_cast<void>(env.release());
}

std::uint64_t RunningBatch::enter(const char* function) {
  if (process_ != getpid())
    throw RunError(function, "the batch was made before a fork and its threads are not in this process; make it here, or send it pickled");
  for (;;) {
    {
      const nb::gil_scoped_release released;
      std::unique_lock lock(mutex_);
      if (is_inside_ && is_abandoned_) left_.wait_for(lock, kBetweenSignalChecks, [this] { return !is_inside_; });
      if (!is_inside_) {
        is_inside_ = true;
        is_abandoned_ = false;
        caller_ = std::this_thread::get_id();
        return ++calls_;
      }
      if (!is_abandoned_ && caller_ == std::this_thread::get_id())
        throw RunError(function, "a signal handler called it amid a call of this batch; a batch takes one caller at a time");
      if (!is_abandoned_) throw RunError(function, "another thread is in a call of this batch; a batch takes one caller at a time");
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  }
}

void RunningBatch::leave() {
  const std::lock_guard lock(mutex_);
  is_inside_ = false;
  left_.notify_all();
}

void RunningBatch::abandon(std::uint64_t call) {
  const std::lock_guard lock(mutex_);
  if (is_inside_ && calls_ == call) is_abandoned_ = true;
}

}  // namespace earshot::python
