// SPDX-License-Identifier: Apache-2.0
// The guards of docs/explanation/ppo.md, section 3, each guard at the first, a middle and the last worker; what is not finite is in
// fault_matrix_test.cpp.
#include <gtest/gtest.h>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "tests/support/workers/fault_bench.h"
#include "trainer/learner/advantage_normalization.h"
#include "trainer/rollout/actor.h"

namespace earshot::faults {
namespace {

const std::unique_ptr<Collective> kSingle = make_single_worker();
Collective& kAlone = *kSingle;

torch::Tensor doubles(const std::vector<double>& values) { return torch::tensor(values, torch::kFloat64).unsqueeze(1); }
torch::Tensor all_valid(const torch::Tensor& rows) { return torch::ones_like(rows).to(torch::kBool); }
double largest(const torch::Tensor& tensor) { return tensor.abs().max().item<double>(); }

TEST(G1_FewRows, NoneAndOneGiveZerosAndNoNaN) {
  const torch::Tensor one = doubles({5});
  EXPECT_EQ(normalize_advantages(one, all_valid(one), kAlone).item<double>(), 0);
  EXPECT_EQ(largest(normalize_advantages(one, torch::zeros_like(one).to(torch::kBool), kAlone)), 0);
  // Two, by hand: mean 3, deviations -1 and 1, biased variance 1.
  const torch::Tensor two = normalize_advantages(doubles({2, 4}), all_valid(doubles({2, 4})), kAlone);
  EXPECT_NEAR(two[0].item<double>(), -1 / (1 + 1e-7), 1e-15);
  EXPECT_NEAR(two[1].item<double>(), 1 / (1 + 1e-7), 1e-15);
}

// One row in all, at each worker in turn; the others have none.  There is a step: value and entropy still have a gradient.
TEST(G1_FewRows, OneRowInTheWholeRun) {
  PpoConfig config = two_by_two();
  config.normalize_advantages = true;
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    rollout.valid.zero_();
    if (now.rank == now.update) rollout.valid[1][2] = 1;
  };
  const std::vector<Outcome> outcomes = work_together(config, kWorkers + 1, seams);
  for (const Outcome& outcome : outcomes)
    for (int update = 0; update <= kWorkers; ++update) {
      const UpdateStats& stats = outcome.updates[static_cast<std::size_t>(update)];
      EXPECT_EQ(stats.skipped_steps, 0);
      EXPECT_EQ(stats.taken_steps,
                update < kWorkers ? 2 : 0);  // its env is in one of two minibatches; in the last update no worker has any
      EXPECT_EQ(stats.policy_loss, 0);       // a single advantage is 0 after centring
    }
  expect_clean_and_equal(outcomes);
}

TEST(G2_ConstantAdvantages, AreExactlyZero) {
  for (const double value : {0.0, 0.1, -3.7e5, 1e12}) {
    const torch::Tensor rows = torch::full({1000, 3}, value, torch::kFloat64);
    EXPECT_EQ(largest(normalize_advantages(rows, all_valid(rows), kAlone)), 0) << value;
    // Equal but for the rounding of float32 that they came with.
    const torch::Tensor rounded = rows * (1 + 2e-8 * noise({1000, 3}, 1, 2, 3).to(torch::kFloat64));
    EXPECT_EQ(largest(normalize_advantages(rounded, all_valid(rows), kAlone)), 0) << value;
  }
}

TEST(G2_ConstantAdvantages, MoveNoPolicyOnAnyWorker) {
  PpoConfig config = two_by_two();
  config.normalize_advantages = true;
  config.value_coefficient = config.entropy_coefficient = 0;
  Seams seams;
  seams.rollout = [](const Moment&, RolloutBuffer& rollout) {  // every row an episode of its own: A = r - V
    rollout.terminated.fill_(1);
    rollout.values.zero_();
    rollout.rewards.fill_(0.1);
  };
  const std::vector<Outcome> outcomes = work_together(config, 2, seams), untouched = work_together(config, 0, {});
  EXPECT_TRUE(same_bits(outcomes[0].weights, untouched[0].weights));
  EXPECT_EQ(outcomes[0].updates[1].gradient_norm, 0);
  expect_clean_and_equal(outcomes);
}

// exp(200) is infinite even times 0.  The ratio is clamped to exp(20), the gradient is clipped, the step is taken, and the worker is named
// by its KL.
TEST(G3_RatioOverflow, IsBoundedReportedAndNamed) {
  for (const float shift : {-200.f, 200.f}) {
    Seams seams;
    seams.rollout = [&](const Moment& now, RolloutBuffer& rollout) {
      if (now.update >= 1 && now.update <= kWorkers && now.rank == now.update - 1) rollout.log_prob.add_(shift);
    };
    const std::vector<Outcome> outcomes = work_together(two_by_two(), kWorkers + 2, seams);
    for (const Outcome& outcome : outcomes)
      for (int update = 0; update < kWorkers + 2; ++update) {
        const UpdateStats& stats = outcome.updates[static_cast<std::size_t>(update)];
        const bool faulty = update >= 1 && update <= kWorkers;
        EXPECT_EQ(stats.skipped_steps, 0);
        EXPECT_EQ(stats.taken_steps, 4);
        // r - 1 - log r is exp(20) - 21 for a ratio that is too large, and exp(-20) - 1 + 20 = 19 for one that is too small: below the
        // alarm of 100.
        EXPECT_EQ(stats.kl_alarms, faulty && shift < 0 ? 4 : 0) << update;
        if (faulty && shift < 0) {
          EXPECT_EQ(stats.alarm_rank, update - 1);
          EXPECT_NEAR(stats.alarm_kl, std::exp(20.0) - 21, 1e-5 * std::exp(20.0));
        }
      }
    expect_clean_and_equal(outcomes);
  }
}

// Gradients from 1e-30 to 1e30, on one worker or on all: the norm is right to float32's rounding, what Adam gets is as long as it may be,
// nothing is skipped.  In float32 the sum of squares is 0 below 1e-23 and infinite above 1e19.
TEST(G5_GradientNorm, IsRightFromTinyToHuge) {
  for (const double scale : {1e-30, 1e-22, 1e-10, 1.0, 1e10, 1e19, 1e30}) {
    for (const int faulty : {kFirst, kMiddle, kLast, -1}) {
      std::array<double, kWorkers> squares{};
      PpoConfig config = two_by_two();
      config.epochs = config.minibatches = 1;
      Seams seams;
      seams.sent = [&](const Moment& now, std::span<float> buffer) {
        for (float& element : buffer.first(buffer.size() - 1))
          element *= static_cast<float>(faulty < 0 || faulty == now.rank ? scale : 0.0);
      };
      seams.received = [&](const Moment& now, std::span<float> buffer) {
        const auto r = static_cast<std::size_t>(now.rank);
        long double sum = 0;
        for (const float element : buffer.first(buffer.size() - 1))
          sum += static_cast<long double>(element) * static_cast<long double>(element);
        // The last element counts the workers with rows.
        squares[r] = static_cast<double>(std::sqrt(sum) / static_cast<long double>(scale) / static_cast<long double>(buffer.back()));
      };
      const std::vector<Outcome> outcomes = work_together(config, 1, seams);
      const UpdateStats& stats = outcomes[0].updates[0];
      ASSERT_EQ(stats.taken_steps, 1) << scale << " " << faulty;
      ASSERT_GT(squares[0], 0);
      EXPECT_NEAR(stats.gradient_norm / scale, squares[0], 1e-12 * squares[0]) << scale << " " << faulty;
      // Adam's first moment after one step is 0.1 of what it got: the gradient, or max_gradient_norm along it.
      double moment = 0;
      for (const auto& [name, tensor] : outcomes[0].adam)
        if (name.ends_with(".exp_avg")) moment += (tensor.to(torch::kFloat64) * 1e8).square().sum().item<double>();
      const double wanted = std::min(stats.gradient_norm, config.max_gradient_norm * stats.gradient_norm / (stats.gradient_norm + 1e-6));
      EXPECT_NEAR(std::sqrt(moment) / 1e8 / 0.1, wanted, 1e-5 * wanted) << scale << " " << faulty;
      expect_clean_and_equal(outcomes);
    }
  }
}

TEST(G6_Entropy, OfMaskedLogitsIsTheLimit) {
  // Minus infinity in ActionDistribution.EntropyByHand; here the largest finite masks, in float32, with gradients.
  for (const float mask : {-1e9f, -3e38f}) {
    torch::Tensor logits = torch::tensor({{0.f, mask, 0.f, mask}}).requires_grad_(true);
    const torch::Tensor h = entropy(logits);
    EXPECT_NEAR(h.item<double>(), std::log(2.0), 1e-6);
    h.sum().backward();
    EXPECT_LT(largest(logits.grad()), 1e-6);  // at its maximum
  }
}

// The minibatches of one worker are empty, or all masked: it joins every average with weight 0, and the others get what they would get
// without it.
TEST(G8_MaskedWorker, HasNoWeightAndDelaysNoWorker) {
  for (const int masked : {kFirst, kMiddle, kLast}) {
    Seams seams;
    seams.rollout = [&](const Moment& now, RolloutBuffer& rollout) {
      if (now.rank == masked) rollout.valid.zero_();
    };
    const std::vector<Outcome> outcomes = work_together(two_by_two(), 2, seams);
    expect_clean_and_equal(outcomes);
    for (const Outcome& outcome : outcomes) EXPECT_EQ(outcome.updates[1].taken_steps, 4);

    // The oracle: that worker's buffer is replaced by nothing on its way, whatever it holds.
    Seams silenced;
    silenced.sent = [&](const Moment& now, std::span<float> buffer) {
      if (now.rank == masked) std::fill(buffer.begin(), buffer.end(), 0.f);
    };
    const std::vector<Outcome> expected = work_together(two_by_two(), 2, silenced);
    EXPECT_TRUE(same_bits(outcomes[0].weights, expected[0].weights));
    // And it would have had a say.
    EXPECT_FALSE(same_bits(outcomes[0].weights, work_together(two_by_two(), 2, {})[0].weights));
  }
}

TEST(G8_MaskedWorker, MoreMinibatchesThanEnvsLeaveEmptyOnes) {
  PpoConfig config = two_by_two();
  config.minibatches = kEnvs + 3;
  const std::vector<Outcome> outcomes = work_together(config, 2, {});
  for (const Outcome& outcome : outcomes) {
    EXPECT_EQ(outcome.updates[0].taken_steps, 2 * kEnvs);
    EXPECT_EQ(outcome.updates[0].skipped_steps, 0);
  }
  expect_clean_and_equal(outcomes);
}

TEST(G8_MaskedWorker, AllMaskedMovesNothing) {
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    if (now.update == 1) rollout.valid.zero_();
  };
  const std::vector<Outcome> outcomes = work_together(two_by_two(), 2, seams), one = work_together(two_by_two(), 1, {});
  EXPECT_TRUE(same_bits(outcomes[0].weights, one[0].weights));  // Adam's moments alone would have moved them
  EXPECT_TRUE(same_bits(outcomes[0].adam, one[0].adam));
  EXPECT_EQ(outcomes[0].updates[1].taken_steps + outcomes[0].updates[1].skipped_steps, 0);
  expect_clean_and_equal(outcomes);
}

// Large rewards at one worker: the step is taken, clipped, and every worker knows who had it.
TEST(G11_LossAlarm, CountsAndNamesTheWorker) {
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    if (now.update < kWorkers && now.rank == now.update) rollout.rewards.fill_(1e4f);
  };
  const std::vector<Outcome> outcomes = work_together(two_by_two(), kWorkers + 1, seams);
  for (const Outcome& outcome : outcomes)
    for (int update = 0; update <= kWorkers; ++update) {
      const UpdateStats& stats = outcome.updates[static_cast<std::size_t>(update)];
      EXPECT_EQ(stats.loss_alarms, update < kWorkers ? 4 : 0);
      EXPECT_EQ(stats.alarm_rank, update < kWorkers ? update : -1);
      EXPECT_EQ(stats.taken_steps, 4);
      if (update < kWorkers) {
        EXPECT_GT(stats.alarm_loss, 30);
      }
    }
  expect_clean_and_equal(outcomes);
}

// Backward runs on the thread that calls it, under the one setting; afterwards that thread has its own setting back.
TEST(G10_Denormals, AreFlushedWhereLearningComputes) {
  if (kFlushDenormals == 0) GTEST_SKIP() << "denormals are kept on every thread of this machine";
  std::array<int, kWorkers> flushed{}, total{};
  Seams seams;
  const auto look = [&](const Moment& now) {
    const auto r = static_cast<std::size_t>(now.rank);
    ++total[r];
    flushed[r] += denormals_are_flushed();
  };
  seams.output = [&](const Moment& now, PolicyOutput&) { look(now); };
  seams.gradient = [&](const Moment& now, torch::Tensor&) { look(now); };
  ASSERT_FALSE(denormals_are_flushed());
  expect_clean_and_equal(work_together(two_by_two(), 1, seams));
  for (std::size_t rank = 0; rank < kWorkers; ++rank) {
    EXPECT_EQ(total[rank], 8);
    EXPECT_EQ(flushed[rank], 8);
  }
  ActorCritic policy(pointgoal_only(), small_policy());
  const auto alone = make_single_worker();
  PpoLearner(policy, two_by_two(), 1).update(collect(policy, 0, 0), 0, 0, *alone);
  EXPECT_FALSE(denormals_are_flushed());
}

}  // namespace
}  // namespace earshot::faults
