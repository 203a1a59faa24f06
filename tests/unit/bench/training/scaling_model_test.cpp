// SPDX-License-Identifier: Apache-2.0
#include "bench/training/scaling_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

// Harter 1961, table 1, and closed forms for two and three.
TEST(ScalingModel, ExpectedOrderStatisticsAreThoseOfTheTables) {
  EXPECT_NEAR(expected_normal_order(1, 1), 0, 1e-6);
  EXPECT_NEAR(expected_normal_order(2, 2), 1 / std::sqrt(std::numbers::pi), 1e-6);
  EXPECT_NEAR(expected_normal_order(3, 3), 1.5 / std::sqrt(std::numbers::pi), 1e-6);
  EXPECT_NEAR(expected_normal_order(8, 8), 1.42360, 1e-5);
  EXPECT_NEAR(expected_normal_order(7, 8), 0.85222, 1e-5);
  EXPECT_NEAR(expected_normal_order(100, 100), 2.50759, 1e-5);
  for (const int n : {5, 1024}) EXPECT_NEAR(expected_normal_order(2, n), -expected_normal_order(n - 1, n), 1e-6);
  EXPECT_NEAR(expected_normal_order(1024, 1024), 3.25, 0.01);
}

TEST(ScalingModel, LinkFromTwoSums) {
  // Two workers: two steps of 10 us, and all of the bytes at 1 GB/s.
  const LinkSpeed link = link_from_sums(5e-5, {1'000'000, 1.02e-3}, {20'000'000, 20.02e-3});
  EXPECT_NEAR(link.step_s, 1e-5, 1e-12);
  EXPECT_NEAR(link.bytes_per_s, 1e9, 1);
  EXPECT_EQ(link.exchange_s, 5e-5);
  EXPECT_THROW(link_from_sums(5e-5, {1'000'000, 2e-3}, {20'000'000, 1e-3}), RunError);
}

// 1 s of rollout with a deviation of 0.1 s, 0.2 s of learning, 4 sums of 20 MB at 1 GB/s with 1 ms per step, 10 exchanges of 0.1 ms, of
// which a message takes 0.01 ms of a core, and a byte 0.4 ns.
constexpr UpdateWork kWork{.rollout_s = 1, .rollout_deviation_s = 0.1, .learn_s = 0.2, .sums = 4, .bytes = 20'000'000, .exchanges = 10};
constexpr LinkSpeed kLink{.exchange_s = 1e-4, .step_s = 1e-3, .bytes_per_s = 1e9, .message_s = 1e-5, .byte_s = 0.4e-9};

TEST(ScalingModel, PartsByHand) {
  const ScalingPrediction alone = predict_update(kWork, kLink, {.workers = 1});
  EXPECT_NEAR(alone.update_s(), 1.2, 1e-6);
  const ScalingPrediction two = predict_update(kWork, kLink, {.workers = 2});
  EXPECT_NEAR(two.collect_s, 1.0564190, 1e-6);
  EXPECT_NEAR(two.reduce_s, 4 * (2 * 1e-3 + 20e-3) + 10 * 1e-4, 1e-9);
  EXPECT_EQ(two.steps, 2);
  const ScalingPrediction eight = predict_update(kWork, kLink, {.workers = 8});
  EXPECT_NEAR(eight.collect_s, 1.142360, 1e-5);
  EXPECT_NEAR(eight.reduce_s, 4 * (14 * 1e-3 + 1.75 * 20e-3) + 10 * (1e-4 + 6 * 1e-5), 1e-9);
  EXPECT_NEAR(scaling_efficiency(kWork, kLink, {.workers = 8}), 1.2 / eight.update_s(), 1e-9);
  // Eight workers on one host of two cores, four to a core: 1.75 x 20 MB of each at 0.4 ns are 56 ms, more than the ring's 49.
  EXPECT_NEAR(predict_update(kWork, kLink, {.workers = 8, .per_host = 8, .cores_per_host = 2}).reduce_s,
              4 * 56e-3 + 10 * (1e-4 + 4 * 6 * 1e-5), 1e-9);
  // Beyond 64 workers rank 0 hears 1,023 and answers them; a sum is that and two exchanges of 1,023 messages with the bytes.
  const double call_s = 2 * (1e-4 + 1022 * 1e-5);
  EXPECT_NEAR(predict_update(kWork, kLink, {.workers = 1024}).reduce_s,
              4 * (call_s + 2046 * 1e-5 + 2 * 1023.0 / 1024 * 20e-3) + 10 * call_s, 1e-9);
}

TEST(ScalingModel, PreemptionWaitsForFewerAndLosesSteps) {
  const WorkerLayout all{.workers = 8}, most{.workers = 8, .preempt_fraction = 0.6};
  const ScalingPrediction waiting = predict_update(kWork, kLink, all), preempted = predict_update(kWork, kLink, most);
  EXPECT_NEAR(preempted.collect_s, 1 + 0.1 * expected_normal_order(5, 8), 1e-9);
  EXPECT_LT(preempted.collect_s, waiting.collect_s);
  EXPECT_GT(preempted.steps, 7);
  EXPECT_LT(preempted.steps, 8);
  EXPECT_GT(scaling_efficiency(kWork, kLink, most), scaling_efficiency(kWork, kLink, all));
  // Where all are alike there is nothing to wait for, and nothing to lose.
  UpdateWork alike = kWork;
  alike.rollout_deviation_s = 0;
  EXPECT_EQ(predict_update(alike, kLink, most).steps, 8);
}

}  // namespace
}  // namespace earshot
