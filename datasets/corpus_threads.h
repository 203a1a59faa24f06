// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>

namespace earshot {

/// The threads that make a corpus: counts their output; the first exception ends all of them.
class CorpusThreads {
 public:
  /// Calls work() on each of `threads` threads and, about five times a second, progress(items made, total) on the caller's, which may be
  /// empty.  Returns when all have ended; throws then what the first of them threw, or progress.  `threads` as CorpusRun::threads, but at
  /// most `most`.
  void run(int threads, std::uint64_t most, std::uint64_t total, const std::function<void(std::uint64_t, std::uint64_t)>& progress,
           const std::function<void()>& work);

  /// From work(): an item is on disk; whether work() should return, as another thread has thrown.
  void count_item() { ++items_; }
  [[nodiscard]] bool failed() const { return failed_; }
  [[nodiscard]] std::uint64_t items() const { return items_; }

 private:
  void run_one(const std::function<void()>& work);

  std::atomic<std::uint64_t> items_ = 0;
  std::atomic<bool> failed_ = false;
  std::mutex mutex_;  ///< guards what follows
  std::condition_variable changed_;
  int ended_ = 0;
  std::exception_ptr error_;
};

}  // namespace earshot
