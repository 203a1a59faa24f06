// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_threads.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

namespace earshot {
namespace {

using testing::Property;
using testing::StrEq;

/// Ends only where it is told that something has failed.
void work_until_failed(CorpusThreads& threads) {
  while (!threads.failed()) {
    threads.count_item();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

TEST(CorpusThreads, CountsWhatAllHaveMade) {
  CorpusThreads threads;
  std::uint64_t seen = 0;
  std::atomic<int> ran = 0;
  threads.run(
      8, 3, 12,
      [&](std::uint64_t made, std::uint64_t total) {
        EXPECT_GE(made, seen);
        EXPECT_EQ(total, 12u);
        seen = made;
      },
      [&] {
        ++ran;
        for (int i = 0; i < 4; ++i) threads.count_item();
      });
  EXPECT_EQ(ran, 3);
  EXPECT_EQ(seen, 12u);
  EXPECT_EQ(threads.items(), 12u);
  EXPECT_FALSE(threads.failed());
}

TEST(CorpusThreads, TheFirstThatThrowsEndsAll) {
  CorpusThreads threads;
  std::atomic<int> number = 0, ended = 0;
  const auto work = [&] {
    if (number++ == 1) throw std::runtime_error("no room on the disk");
    work_until_failed(threads);
    ++ended;
  };
  EXPECT_THAT([&] { threads.run(4, 100, 100, nullptr, work); },
              testing::Throws<std::runtime_error>(Property(&std::runtime_error::what, StrEq("no room on the disk"))));
  EXPECT_EQ(ended, 3);
}

TEST(CorpusThreads, ProgressThatThrowsEndsAll) {
  CorpusThreads threads;
  std::atomic<int> ended = 0;
  const auto progress = [](std::uint64_t, std::uint64_t) { throw std::runtime_error("interrupted"); };
  const auto work = [&] {
    work_until_failed(threads);
    ++ended;
  };
  EXPECT_THAT([&] { threads.run(4, 100, 100, progress, work); },
              testing::Throws<std::runtime_error>(Property(&std::runtime_error::what, StrEq("interrupted"))));
  EXPECT_EQ(ended, 4);
}

}  // namespace
}  // namespace earshot
