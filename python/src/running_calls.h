// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "python/src/bindings.h"

namespace earshot::python {

/// A wait looks at signals so often.
constexpr std::chrono::milliseconds kBetweenSignalChecks{50};

/// Counts a call of the engine that runs, so that a fork and the end of the process can wait for it.
class RunningCall {
 public:
  /// With the GIL.  While another thread prepares a fork, waits for that without the GIL.
  /// @throws nb::python_error where a signal handler of Python raises meanwhile.
  RunningCall();
  ~RunningCall();
  RunningCall(const RunningCall&) = delete;
  RunningCall& operator=(const RunningCall&) = delete;
};

/// Work that goes on after the call that began it.  A fork and the end of the process wait until it is at rest.
class BackgroundWork {
 public:
  BackgroundWork() = default;
  BackgroundWork(const BackgroundWork&) = delete;
  BackgroundWork& operator=(const BackgroundWork&) = delete;
  /// From any thread, while others work.  Takes no lock.
  [[nodiscard]] virtual bool is_at_rest() const = 0;

 protected:
  ~BackgroundWork() = default;
  /// From begin_watch() to end_watch() is_at_rest() may be called.
  void begin_watch();
  void end_watch();
};

/// Whether this is the thread in which Python runs signal handlers.
bool is_main_thread();
/// @throws RunError in a process that was forked while a call was running elsewhere: locks of the engine may be held for ever there.
void require_usable_process();

}  // namespace earshot::python
