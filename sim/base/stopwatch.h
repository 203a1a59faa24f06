// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <ctime>

namespace earshot {

/// Seconds since construction, of the wall and of this thread's processor: on a shared machine the two differ.
class Stopwatch {
 public:
  Stopwatch() : wall_(std::chrono::steady_clock::now()), cpu_s_(thread_cpu_s()) {}
  [[nodiscard]] double wall_s() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_).count(); }
  [[nodiscard]] double wall_ms() const { return 1e3 * wall_s(); }
  [[nodiscard]] double cpu_s() const { return thread_cpu_s() - cpu_s_; }

 private:
  static double thread_cpu_s() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }
  std::chrono::steady_clock::time_point wall_;
  double cpu_s_;
};

}  // namespace earshot
