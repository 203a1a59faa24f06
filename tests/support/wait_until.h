// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <signal.h>
#include <sys/types.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <span>
#include <thread>

namespace earshot {

/// Whether a child process of the caller has ended.  It stays to be waited for.
inline bool has_ended(pid_t child) {
  siginfo_t info{};
  return ::waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid != 0;
}

/// Waits until another thread or process makes is_met() true.  False after so many seconds, and as soon as one of `needed` has ended
/// (children of the caller, those above 0): a test that has failed before must end all the same, and say so.
template <class Condition>
bool wait_until(const Condition& is_met, double seconds = 120, std::span<const pid_t> needed = {}) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!is_met()) {
    if (std::chrono::steady_clock::now() > end) return false;
    if (std::ranges::any_of(needed, [](pid_t child) { return child > 0 && has_ended(child); })) return is_met();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}
inline bool wait_for_flag(const std::atomic<bool>& flag) {
  return wait_until([&] { return flag.load(); });
}

}  // namespace earshot
