#pragma once

#include <chrono>
#include <ctime>
#include <vector>

namespace earshot {

/// A repeated measurement.
struct Measured {
  double value = 0, min = 0, max = 0;  ///< value: the median
};
/// Median (of an even count: mean of the two in the middle), smallest and largest.  values: not empty.
Measured median_of(std::vector<double> values);

/// Seconds since construction, of the wall and of this thread's processor: on a shared machine the two differ.
class Stopwatch {
 public:
  Stopwatch() : wall_(std::chrono::steady_clock::now()), cpu_s_(thread_cpu_s()) {}
  [[nodiscard]] double wall_s() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_).count(); }
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
