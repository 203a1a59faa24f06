// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <type_traits>
#include <utility>

#include "python/src/bindings.h"
#include "python/src/running_calls.h"

namespace earshot::python {

/// Runs `work` on a helper thread and waits for it without the GIL.  When a signal handler of Python raises, asks `work` to stop and throws
/// nb::python_error at once: `work` may then go on in the background, with what it owns.  Rethrows what `work` throws.  A signal handler
/// may itself get here: each call has a helper thread of its own.
/// @throws RunError in a child that a signal handler has forked, where `work` ran at the fork.
void run_on_helper(std::function<void()> work, std::stop_source stop);

/// The result of `work(stop)`, computed without the GIL.  Called with the GIL, as from any binding.  In Python's main thread a signal ends
/// the wait within 0.1 s; `work` must therefore own what it uses, and no Python object.
template <class Work>
auto interruptible(Work work) -> std::invoke_result_t<Work&, const std::stop_token&> {
  using Result = std::invoke_result_t<Work&, const std::stop_token&>;
  require_usable_process();
  const std::stop_source stop;
  if (!is_main_thread()) {
    const RunningCall running;
    const nb::gil_scoped_release released;
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

}  // namespace earshot::python
