// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <stop_token>
#include <thread>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/kept_results.h"
#include "sim/base/random.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using Squares = KeptResults<int, int>;

std::shared_ptr<const int> square(int key) { return std::make_shared<const int>(key * key); }

TEST(KeptResults, EachIsMadeOnceForAnyNumberOfThreads) {
  Squares squares;
  std::atomic<int> made{0};
  {
    std::vector<std::jthread> threads;
    for (std::uint32_t thread = 0; thread < 8; ++thread)
      threads.emplace_back([&, thread] {
        const RandomStream random(5, Purpose::episode, thread);
        for (std::uint32_t draw = 0; draw < 200; ++draw) {
          const auto key = static_cast<int>(random.below(20, draw));
          const auto found = squares.get(key, [&] {
            ++made;
            return square(key);
          });
          EXPECT_EQ(*found, key * key);
        }
      });
  }
  EXPECT_EQ(made, 20);
}

TEST(KeptResults, OneThatIsBeingMadeKeepsNobodyFromOthers) {
  Squares squares;
  (void)squares.get(1, [] { return square(1); });
  std::atomic<bool> is_begun{false}, may_end{false};
  std::jthread slow([&] {
    (void)squares.get(2, [&] {
      is_begun = true;
      EXPECT_TRUE(wait_for_flag(may_end));
      return square(2);
    });
  });
  ASSERT_TRUE(wait_for_flag(is_begun));
  EXPECT_EQ(*squares.get(1, [] { return square(0); }), 1) << "that which is there is found";
  EXPECT_EQ(*squares.get(3, [] { return square(3); }), 9) << "another is made";
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)squares.get(
                   2, [] { return square(0); }, stop.get_token()),
               RunError)
      << "a wait ends with its caller";
  EXPECT_EQ(*squares.get(
                3, [] { return square(0); }, stop.get_token()),
            9)
      << "what needs no wait needs no caller";
  may_end = true;
  EXPECT_EQ(*squares.get(2, [] { return square(0); }), 4);
}

TEST(KeptResults, AStopEndsAWaitUnderWay) {
  Squares squares;
  std::atomic<bool> is_begun{false}, may_end{false}, has_stopped{false};
  std::jthread slow([&] {
    (void)squares.get(2, [&] {
      is_begun = true;
      EXPECT_TRUE(wait_for_flag(may_end));
      return square(2);
    });
  });
  ASSERT_TRUE(wait_for_flag(is_begun));
  std::stop_source stop;
  std::jthread waits([&] {
    EXPECT_THROW((void)squares.get(
                     2, [] { return square(0); }, stop.get_token()),
                 RunError);
    has_stopped = true;
  });
  stop.request_stop();
  EXPECT_TRUE(wait_for_flag(has_stopped));
  may_end = true;
}

TEST(KeptResults, AFailureIsOfItsCallerAlone) {
  Squares squares;
  EXPECT_THROW((void)squares.get(1, []() -> std::shared_ptr<const int> { throw InputError("one", "fails", "try again"); }), InputError);
  std::atomic<int> failures{0};
  {
    std::vector<std::jthread> threads;
    for (int thread = 0; thread < 6; ++thread)
      threads.emplace_back([&] {
        try {
          EXPECT_EQ(*squares.get(1,
                                 [&] {
                                   if (failures < 3) {
                                     ++failures;
                                     throw InputError("one", "fails", "try again");
                                   }
                                   return square(1);
                                 }),
                    1);
        } catch (const InputError&) {
        }
      });
  }
  EXPECT_EQ(failures, 3);
  EXPECT_EQ(*squares.get(1, [] { return square(0); }), 1);
}

TEST(KeptResults, AResultIsDroppedOnlyWhileItIsTheOne) {
  Squares squares;
  const auto first = squares.get(4, [] { return square(4); });
  squares.drop(4, square(4));
  EXPECT_EQ(squares.get(4, [] { return square(0); }), first) << "another value of the same number";
  squares.drop(5, first);
  squares.drop(4, first);
  const auto second = squares.get(4, [] { return square(3); });
  EXPECT_EQ(*second, 9);
  EXPECT_EQ(*first, 16) << "who holds it keeps it";
  squares.drop(4, first);
  EXPECT_EQ(squares.get(4, [] { return square(0); }), second) << "it has been replaced";
}

}  // namespace
}  // namespace earshot
