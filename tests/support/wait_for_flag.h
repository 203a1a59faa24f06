// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <thread>

namespace earshot {

/// Waits until another thread or process makes this true.  False after two minutes: a test that has failed before must end all the same.
template <class Condition>
bool wait_until(const Condition& is_met) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (!is_met()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}
inline bool wait_for_flag(const std::atomic<bool>& flag) {
  return wait_until([&] { return flag.load(); });
}

}  // namespace earshot
