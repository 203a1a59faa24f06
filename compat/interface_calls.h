// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <exception>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <utility>

#include "compat/call_error.h"
#include "compat/context_registry.h"
#include "sim/base/errors.h"

namespace earshot::compat {

/// Runs `call`; the code of what it throws, and the line for stderr, which say() gets as "FUNCTION: LINE".
template <class Call, class Say>
RLRA_Error run_call(const char* function, Call&& call, Say&& say) noexcept {
  try {
    RLRA_Error code = RLRA_UnknownError;
    std::string line;
    try {
      call();
      return RLRA_Success;
    } catch (const CallError& error) {
      code = error.code();
      line = error.what();
    } catch (const InputError& error) {
      code = RLRA_InvalidParameter;
      line = error.what();
    } catch (const std::bad_alloc&) {
      code = RLRA_OutOfMemory;
      line = "out of memory";
    } catch (const std::exception& error) {
      line = error.what();
    } catch (...) {
      line = "unknown error";
    }
    say(fmt::format("{}: {}", function, line));
    return code;
  } catch (...) {  // not even the line could be made
    return RLRA_OutOfMemory;
  }
}

/// The same without a context.
template <class Call>
RLRA_Error run_call(const char* function, Call&& call) noexcept {
  return run_call(function, call, [](const std::string& line) { print_line(line); });
}

/// call(context), alone with it.
template <class Call>
RLRA_Error run_for(const char* function, RLRA_Context handle, Call&& call) noexcept {
  try {
    const std::shared_ptr<SharedContext> shared = find_context(handle);
    if (!shared) return RLRA_Uninitialized;
    const std::lock_guard lock(shared->mutex);
    return run_call(
        function, [&] { call(shared->context); }, [&](const std::string& line) { shared->context.warn_once(line); });
  } catch (...) {
    return RLRA_UnknownError;
  }
}

/// The value of call(context); `fallback` on any error.  Prints no line: callers ask by a count whether an index exists.
template <class Value, class Call>
Value value_for(RLRA_Context handle, Value fallback, Call&& call) noexcept {
  try {
    const std::shared_ptr<SharedContext> shared = find_context(handle);
    if (!shared) return fallback;
    const std::lock_guard lock(shared->mutex);
    return call(std::as_const(shared->context));
  } catch (...) {
    return fallback;
  }
}

}  // namespace earshot::compat
