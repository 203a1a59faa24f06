// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/liveness.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace earshot {
namespace {

using std::chrono::milliseconds;

TEST(LivenessLimits, ProgressIsToldEightTimesWithinThePatience) {
  RingConfig config;
  config.timeout = milliseconds(1234);
  config.network.progress_timeout_s = 8;
  const Liveness::Limits limits = Liveness::limits_of(config, milliseconds(50));
  EXPECT_EQ(limits.timeout, milliseconds(1234));
  EXPECT_EQ(limits.patience, milliseconds(8000));
  EXPECT_EQ(limits.grace, milliseconds(50));
  EXPECT_EQ(limits.progress_interval.count(), 1.0);
  config.network.progress_timeout_s = 600;
  EXPECT_EQ(Liveness::limits_of(config, milliseconds(50)).progress_interval.count(), 5.0);
}

class LivenessTest : public testing::Test {
 protected:
  static RingConfig config() {
    RingConfig config;
    config.identity = {0, 3};
    config.rendezvous = "tcp://127.0.0.1:1";  // nothing connects to it
    config.run_id = "liveness";
    return config;
  }
  const RingConfig config_ = config();
  PeerLinks links_{config_, milliseconds(0)};
  Liveness liveness_{{.timeout = milliseconds(100'000),
                      .patience = milliseconds(600'000),
                      .grace = milliseconds(10),
                      .progress_interval = std::chrono::duration<double>(0.01)},
                     links_,
                     3};
};

TEST_F(LivenessTest, ADeadlineIsOfTheCallAndAnyProgressMovesIt) {
  liveness_.begin(4);
  EXPECT_EQ(liveness_.call(), 4u);
  const auto first = liveness_.deadline();
  EXPECT_EQ(first - liveness_.call_began(), milliseconds(100'000));
  while (Liveness::Clock::now() == liveness_.call_began()) {
  }
  liveness_.prolong();
  EXPECT_GT(liveness_.deadline(), first);
  EXPECT_GT(liveness_.time_left(), milliseconds(0));
  EXPECT_LE(liveness_.time_left(), milliseconds(100'001));
}

// Silence counts from the last message, and at most since the given time.
TEST_F(LivenessTest, APeerIsSilentWhoseLoopSaysNothing) {
  const auto hour_ago = Liveness::Clock::now() - std::chrono::hours(1);
  EXPECT_GE(liveness_.silence(1, hour_ago), std::chrono::hours(1)) << "never heard";
  EXPECT_LT(liveness_.silence(1, Liveness::Clock::now()), std::chrono::minutes(5));
  liveness_.greet(1);
  EXPECT_LT(liveness_.silence(1, hour_ago), std::chrono::minutes(5)) << "greeted";
  EXPECT_GE(liveness_.silence(2, hour_ago), std::chrono::hours(1));
  liveness_.hear(2);
  EXPECT_LT(liveness_.silence(2, hour_ago), std::chrono::minutes(5)) << "heard";

  liveness_.begin(1);
  EXPECT_FALSE(liveness_.is_silent(1));
  Liveness impatient({.timeout = milliseconds(100'000), .patience = milliseconds(0), .grace = milliseconds(0), .progress_interval = {}},
                     links_, 3);
  impatient.begin(1);
  EXPECT_TRUE(impatient.is_silent(1));
  EXPECT_THAT(impatient.describe_silence(), testing::HasSubstr("no progress for 0 ms in or before collective call 1"));
  EXPECT_FALSE(impatient.is_gone(1)) << "no connection broke";
}

TEST_F(LivenessTest, AGoodbyeIsKnownUntilTheNextConnection) {
  EXPECT_FALSE(liveness_.finished_after(2));
  liveness_.finish(2, 17);
  EXPECT_EQ(liveness_.finished_after(2), 17u);
  liveness_.greet(2);
  EXPECT_FALSE(liveness_.finished_after(2));
}

TEST_F(LivenessTest, ErrorsNameTheWorkers) {
  liveness_.begin(9);
  liveness_.finish(2, 17);
  EXPECT_THAT(liveness_.has_left(2).what(), testing::AllOf(testing::HasSubstr("worker 2"), testing::HasSubstr("17")));
  EXPECT_THAT(liveness_.missed({1, 2}).what(),
              testing::AllOf(testing::HasSubstr("worker 1, 2"), testing::HasSubstr("call 9"), testing::HasSubstr("100000 ms")));
}

}  // namespace
}  // namespace earshot
