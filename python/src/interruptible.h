// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <type_traits>
#include <utility>

#include "python/src/bindings.h"

namespace earshot::python {

/// Counts the calls of the engine that run, so that a fork can wait for them.
class RunningCall {
 public:
  RunningCall();
  ~RunningCall();
  RunningCall(const RunningCall&) = delete;
  RunningCall& operator=(const RunningCall&) = delete;
};

/// Whether this is the thread in which Python runs signal handlers.
bool is_main_thread();
/// Runs `work` on a helper thread and waits for it without the GIL.  When a signal handler of Python raises, asks `work` to stop and throws
/// nb::python_error at once: `work` may then go on in the background, with what it owns.  Rethrows what `work` throws.
void run_on_helper(std::function<void()> work, std::stop_source stop);
/// @throws RunError in a process that was forked while a call was running elsewhere: locks of the engine may be held for ever there.
void require_usable_process();

/// The result of `work(stop)`, computed without the GIL.  Called with the GIL, as from any binding.  In Python's main thread a signal ends
/// the wait within 0.1 s; `work` must therefore own what it uses, and no Python object.
template <class Work>
auto interruptible(Work work) -> std::invoke_result_t<Work&, const std::stop_token&> {
  using Result = std::invoke_result_t<Work&, const std::stop_token&>;
  require_usable_process();
  const std::stop_source stop;
  if (!is_main_thread()) {
    const nb::gil_scoped_release released;
    const RunningCall running;
    return work(stop.get_token());
  }
  if constexpr (std::is_void_v<Result>) {
    run_on_helper([work = std::move(work), token = stop.get_token()]() mutable { work(token); }, stop);
  } else {
    auto result = std::make_shared<std::optional<Result>>();
    run_on_helper([work = std::move(work), result, token = stop.get_token()]() mutable { result->emplace(work(token)); }, stop);
    return std::move(**result);
  }
}

/// fork() and the functions that Python's os.register_at_fork calls around it.
void bind_forks(nb::module_& m);

}  // namespace earshot::python
