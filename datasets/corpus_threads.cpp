// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_threads.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "sim/base/denormals.h"

namespace earshot {

void CorpusThreads::run(int threads, std::uint64_t most, std::uint64_t total,
                        const std::function<void(std::uint64_t, std::uint64_t)>& progress, const std::function<void()>& work) {
  const unsigned wanted = threads > 0 ? static_cast<unsigned>(threads) : std::max(1U, std::thread::hardware_concurrency());
  const auto count = static_cast<int>(std::min<std::uint64_t>(most, wanted));
  {
    std::vector<std::jthread> workers;
    try {
      for (int i = 0; i < count; ++i) workers.emplace_back([&] { run_one(work); });
      for (bool ended = false; !ended;) {
        {
          std::unique_lock lock(mutex_);
          ended = changed_.wait_for(lock, std::chrono::milliseconds(200), [&] { return ended_ == count; });
        }
        if (progress) progress(items_, total);
      }
    } catch (...) {  // of a thread that cannot be started, or of progress: those that work end before it goes on
      failed_ = true;
      throw;
    }
  }
  if (error_) std::rethrow_exception(error_);
}

void CorpusThreads::run_one(const std::function<void()>& work) {
  flush_denormals_on_this_thread();
  try {
    work();
  } catch (...) {
    const std::lock_guard lock(mutex_);
    if (!error_) error_ = std::current_exception();
    failed_ = true;
  }
  const std::lock_guard lock(mutex_);
  ++ended_;
  changed_.notify_all();
}

}  // namespace earshot
