// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <functional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "sim/base/errors.h"
#include "tests/support/seconds_since.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/summed_addends.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {

/// Sums of one size over all workers, as a serial computation gives them: made once, before the workers are forked.
template <class T>
struct SerialSums {
  SerialSums(int world_size, const std::vector<std::size_t>& counts) {
    for (const std::size_t count : counts) expected.push_back(serial_sums<T>(count, world_size));
  }
  /// Whether the workers' sums have the same bits.
  bool equal_those_of(Collective& workers) const {
    for (const std::vector<T>& sums : expected) {
      std::vector<T> buffer = addends<T>(workers.identity().rank, sums.size());
      workers.all_reduce_sum(std::span<T>(buffer));
      if (std::memcmp(buffer.data(), sums.data(), sums.size() * sizeof(T)) == 0) continue;
      std::fprintf(stderr, "%zu elements of %zu bytes: other bits than a serial sum\n", sums.size(), sizeof(T));
      return false;
    }
    return true;
  }
  std::vector<std::vector<T>> expected;
};

/// What a call throws, or "no error".
inline std::string run_error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const RunError& error) {
    return error.what();
  }
  return "no error";
}

inline bool tells(const std::string& error, const std::vector<std::string>& texts) {
  const auto lacks = std::ranges::find_if(texts, [&](const std::string& text) { return error.find(text) == std::string::npos; });
  if (lacks == texts.end()) return true;
  std::fprintf(stderr, "'%s' lacks '%s'\n", error.c_str(), lacks->c_str());
  return false;
}

/// Counts workers that have come to one point.
class Arrivals {
 public:
  void arrive() { ++count_[0]; }
  bool has(int workers) { return count_[0] >= workers; }
  void wait_for(int workers) {
    EXPECT_TRUE(wait_until([&] { return has(workers); }, WorkerProcesses::kAlarm_s));
  }

 private:
  SharedArray<std::atomic<int>, 1> count_;
};

}  // namespace earshot
