// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "sim/base/process/isolated_call.h"
#include "tests/support/programs/isolated_calls.h"

namespace earshot {
namespace {

using namespace isolated_calls;

TEST(IsolatedCall, IsSafeBesideOtherThreads) {
  std::atomic<bool> stop = false;
  std::vector<std::thread> busy;
  for (int i = 0; i < 3; ++i)  // a copy of this process would find the allocator locked sooner or later
    busy.emplace_back([&stop, i] {
      for (std::size_t size = 1; !stop; size = size * 7 % 100'003 + 1) std::string(size + static_cast<std::size_t>(i), 'x').shrink_to_fit();
    });
  std::atomic<int> wrong = 0;
  std::vector<std::thread> callers;
  for (int i = 0; i < 6; ++i)
    callers.emplace_back([&wrong, i] {
      for (int round = 0; round < 8; ++round) {
        const std::string text = std::to_string(100 * i + round);
        if (round % 4 == 3
                ? refusal({"segv"}).find("crashes") == std::string::npos && refusal({"segv"}).find("exit with code") == std::string::npos
                : call({"echo", text}) != text)
          ++wrong;
      }
    });
  for (auto& thread : callers) thread.join();
  stop = true;
  for (auto& thread : busy) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_FALSE(has_children());
}

}  // namespace
}  // namespace earshot
