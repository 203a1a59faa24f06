// SPDX-License-Identifier: Apache-2.0
// docs/explanation/ppo.md, section 3: NaN and infinity in an observation, a reward, a logit, a value, a gradient and a message, at the
// first, a middle and the last worker, over the real collective.  Each update of a run has one fault, so one run goes through all places
// and values.
#include <gtest/gtest.h>

#include "sim/base/files.h"
#include "tests/support/workers/fault_bench.h"

namespace earshot::faults {
namespace {

/// Update 0 has no fault; update 1 + 3 v + r has value v at worker r; the last update has no fault.
struct Plan {
  std::vector<float> values;
  [[nodiscard]] int updates() const { return 2 + kWorkers * static_cast<int>(values.size()); }
  [[nodiscard]] bool faulty(int update) const { return update > 0 && update < updates() - 1; }
  [[nodiscard]] int faulty_rank(int update) const { return (update - 1) % kWorkers; }
  [[nodiscard]] float value(int update) const { return values[static_cast<std::size_t>((update - 1) / kWorkers)]; }
  [[nodiscard]] bool hits(const Moment& now) const { return faulty(now.update) && now.rank == faulty_rank(now.update); }
  /// One minibatch of the update, another one from update to update.
  [[nodiscard]] bool hits_minibatch(const Moment& now) const { return hits(now) && now.minibatch == now.update % 4; }
};

/// What must follow from faults that each spoil `spoiled` of the four steps of their update.
void expect_skipped_alike(const Plan& plan, const Seams& seams, int spoiled, SkipCause cause, const PpoConfig& config = two_by_two()) {
  const std::vector<Outcome> outcomes = work_together(config, plan.updates(), seams);
  for (int update = 0; update < plan.updates(); ++update) {
    const auto u = static_cast<std::size_t>(update);
    const std::vector<SkippedStep>& first = outcomes[0].updates[u].skipped;
    for (int rank = 0; rank < kWorkers; ++rank) {
      const UpdateStats& stats = outcomes[static_cast<std::size_t>(rank)].updates[u];
      const bool is_own_fault = plan.faulty(update) && cause == SkipCause::gradient && rank == plan.faulty_rank(update);
      ASSERT_EQ(stats.skipped_steps, plan.faulty(update) ? spoiled : 0) << "update " << update << ", worker " << rank;
      EXPECT_EQ(stats.taken_steps, 4 - stats.skipped_steps);
      EXPECT_EQ(stats.non_finite_here, is_own_fault ? spoiled : 0) << "update " << update << ", worker " << rank;
      EXPECT_TRUE(std::isfinite(stats.policy_loss) && std::isfinite(stats.value_loss) && std::isfinite(stats.gradient_norm));
      for (std::size_t i = 0; i < stats.skipped.size(); ++i) {
        EXPECT_EQ(stats.skipped[i].epoch, first[i].epoch);
        EXPECT_EQ(stats.skipped[i].minibatch, first[i].minibatch);
        EXPECT_EQ(stats.skipped[i].cause, cause);
        EXPECT_EQ(stats.skipped[i].faulty_ranks, cause == SkipCause::sum ? std::vector<int>{} : std::vector<int>{plan.faulty_rank(update)});
      }
    }
  }
  expect_clean_and_equal(outcomes);
  const int taken = 4 * plan.updates() - spoiled * (plan.updates() - 2);
  for (const auto& [name, tensor] : outcomes[0].adam)
    if (name.ends_with(".step")) {
      EXPECT_EQ(tensor.item<std::int64_t>(), taken) << name;
    }

  // The oracle: the same run without faults, in which those steps are left out because no worker has rows for them.  A fault leaves no
  // other trace.
  Seams left_out;
  left_out.sent = [&](const Moment& now, std::span<float> buffer) {
    for (const SkippedStep& step : outcomes[0].updates[static_cast<std::size_t>(now.update)].skipped)
      if (now.minibatch == 2 * step.epoch + step.minibatch) std::fill(buffer.begin(), buffer.end(), 0.f);
  };
  const std::vector<Outcome> expected = work_together(config, plan.updates(), left_out);
  EXPECT_TRUE(same_bits(outcomes[0].weights, expected[0].weights));
  EXPECT_TRUE(same_bits(outcomes[0].adam, expected[0].adam));
  // And the run went on: without the steps of the last update the weights are others.
  const std::vector<Outcome> shorter = work_together(config, plan.updates() - 1, left_out);
  EXPECT_FALSE(same_bits(outcomes[0].weights, shorter[0].weights));
}

const Plan kAll{{kNan, kInfinity, -kInfinity}};

TEST(G4_FaultMatrix, Observation) {
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    if (kAll.hits(now)) rollout.observations["pointgoal"][now.update % kSteps][now.update % kEnvs][0] = kAll.value(now.update);
  };
  expect_skipped_alike(kAll, seams, 2, SkipCause::gradient);  // its env is in one of two minibatches, in each of two epochs
}

TEST(G4_FaultMatrix, Reward) {
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    if (kAll.hits(now)) rollout.rewards[now.update % kSteps][now.update % kEnvs] = kAll.value(now.update);
  };
  expect_skipped_alike(kAll, seams, 2, SkipCause::gradient);
}

// Mean and variance are pooled: one worker's NaN must not become the advantage of all, nor all ranks faulty.
TEST(G4_FaultMatrix, RewardWithPooledNormalization) {
  PpoConfig config = two_by_two();
  config.normalize_advantages = true;
  const Plan plan{{kNan, kInfinity}};
  Seams seams;
  seams.rollout = [&](const Moment& now, RolloutBuffer& rollout) {
    if (plan.hits(now)) rollout.rewards[now.update % kSteps][now.update % kEnvs] = plan.value(now.update);
  };
  const std::vector<Outcome> outcomes = work_together(config, plan.updates(), seams);
  for (int update = 0; update < plan.updates(); ++update)
    for (const Outcome& outcome : outcomes) {
      const UpdateStats& stats = outcome.updates[static_cast<std::size_t>(update)];
      ASSERT_EQ(stats.skipped_steps, plan.faulty(update) ? 2 : 0) << update;
      for (const SkippedStep& step : stats.skipped) EXPECT_EQ(step.faulty_ranks, std::vector<int>{plan.faulty_rank(update)});
    }
  expect_clean_and_equal(outcomes);
}

TEST(G4_FaultMatrix, Logit) {
  const Plan plan{{kNan, kInfinity}};  // minus infinity is a masked action: ActionDistribution.EntropyByHand
  Seams seams;
  seams.output = [&](const Moment& now, PolicyOutput& output) {
    if (!plan.hits_minibatch(now)) return;
    torch::Tensor fault = torch::zeros_like(output.logits);
    fault[now.update % output.logits.size(0)][now.update % 4] = plan.value(now.update);
    output.logits = output.logits + fault;
  };
  expect_skipped_alike(plan, seams, 1, SkipCause::gradient);
}

TEST(G4_FaultMatrix, Value) {
  Seams seams;
  seams.output = [](const Moment& now, PolicyOutput& output) {
    if (!kAll.hits_minibatch(now)) return;
    torch::Tensor fault = torch::zeros_like(output.value);
    fault[now.update % output.value.size(0)] = kAll.value(now.update);
    output.value = output.value + fault;
  };
  expect_skipped_alike(kAll, seams, 1, SkipCause::gradient);
}

TEST(G4_FaultMatrix, Gradient) {
  Seams seams;
  seams.gradient = [](const Moment& now, torch::Tensor& gradient) {
    if (kAll.hits_minibatch(now)) gradient.view(-1)[now.update % gradient.numel()] = kAll.value(now.update);
  };
  expect_skipped_alike(kAll, seams, 1, SkipCause::gradient);
}

// Damaged after the worker found it good: it reaches all workers, and none can tell where it came from.
TEST(G4_FaultMatrix, MessageOnTheWayIn) {
  Seams seams;
  seams.sent = [](const Moment& now, std::span<float> buffer) {
    if (kAll.hits_minibatch(now)) buffer[static_cast<std::size_t>(now.update * 37) % buffer.size()] = kAll.value(now.update);
  };
  expect_skipped_alike(kAll, seams, 1, SkipCause::sum);
}

// Damaged on the way to one worker: it alone would skip the step, or take another one, and never have equal weights again.
TEST(G4_FaultMatrix, MessageOnTheWayOut) {
  const Plan plan{{kNan, kInfinity, -kInfinity, 0.125f}};
  Seams seams;
  seams.received = [&](const Moment& now, std::span<float> buffer) {
    if (plan.hits_minibatch(now)) buffer[static_cast<std::size_t>(now.update * 37) % buffer.size()] = plan.value(now.update);
  };
  expect_skipped_alike(plan, seams, 1, SkipCause::message);
}

// The finite contributions of three workers overflow in their sum.
TEST(G4_FaultMatrix, SumThatOverflows) {
  const Plan plan{{3e38f}};
  Seams seams;
  seams.sent = [&](const Moment& now, std::span<float> buffer) {
    if (plan.faulty(now.update) && now.minibatch == now.update % 4) buffer[5] = plan.value(now.update);
  };
  expect_skipped_alike(plan, seams, 1, SkipCause::sum);
}

TEST(G4_FaultMatrix, TwoFaultyRanksAtOnceAreBothNamed) {
  Seams seams;
  seams.gradient = [](const Moment& now, torch::Tensor& gradient) {
    if (now.rank != kMiddle && now.update == 1 && now.minibatch == 2) gradient.fill_(kNan);
  };
  const std::vector<Outcome> outcomes = work_together(two_by_two(), 3, seams);
  for (const Outcome& outcome : outcomes) {
    ASSERT_EQ(outcome.updates[1].skipped.size(), 1u);
    EXPECT_EQ(outcome.updates[1].skipped[0].faulty_ranks, (std::vector<int>{kFirst, kLast}));
    EXPECT_EQ(describe(outcome.updates[1].skipped[0]), "the loss or gradient of workers 0, 2 is not finite");
  }
  expect_clean_and_equal(outcomes);
}

// The same in processes of their own, each with its own libtorch.
TEST(G4_FaultMatrix, InRealProcesses) {
  const PrivateTestFolder folder;
  SharedArray<std::uint64_t, kWorkers> hashes;
  constexpr int updates = 2 + kWorkers;
  Seams seams;
  seams.rollout = [](const Moment& now, RolloutBuffer& rollout) {
    if (now.update >= 1 && now.update <= kWorkers && now.rank == now.update - 1) rollout.rewards[2][1] = kNan;
  };
  seams.gradient = [](const Moment& now, torch::Tensor& gradient) {
    if (now.update == kWorkers + 1 && now.rank == kMiddle && now.minibatch == 3) gradient.fill_(kInfinity);
  };
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const auto ring = make_zmq_ring(ring_in(folder, rank, kWorkers));
    const Outcome outcome = work(*ring, two_by_two(), updates, seams);
    std::uint64_t hash = 0;
    for (const auto* tensors : {&outcome.weights, &outcome.adam})
      for (const auto& [name, tensor] : *tensors)
        hash = hash64(std::as_bytes(std::span(static_cast<const std::byte*>(tensor.data_ptr()), tensor.nbytes())), hash);
    hashes[static_cast<std::size_t>(rank)] = hash;
    bool good = faults::all_finite(outcome.weights) && faults::all_finite(outcome.adam) && outcome.updates[0].skipped_steps == 0;
    for (int update = 1; update <= kWorkers; ++update) {
      const auto& skipped = outcome.updates[static_cast<std::size_t>(update)].skipped;
      good = good && skipped.size() == 2 && skipped[0].faulty_ranks == std::vector<int>{update - 1} &&
             skipped[1].faulty_ranks == std::vector<int>{update - 1};
    }
    const auto& last = outcome.updates[kWorkers + 1].skipped;
    return good && last.size() == 1 && last[0].epoch == 1 && last[0].minibatch == 1 && last[0].faulty_ranks == std::vector<int>{kMiddle};
  });
  workers.expect_all_succeed();
  EXPECT_NE(hashes[0], 0u);
  EXPECT_EQ(hashes[1], hashes[0]);
  EXPECT_EQ(hashes[2], hashes[0]);
}

TEST(G4_StepDecision, Table) {
  const StepStatus good{.sum_hash = 7}, other{.sum_hash = 8}, faulty{.finite_here = false, .finite_sum = false},
      received_nan{.finite_sum = false, .sum_hash = 9}, received_other_nan{.finite_sum = false, .sum_hash = 10};
  const auto expect = [](const std::vector<StepStatus>& statuses, bool take, SkipCause cause, const std::vector<int>& faulty_ranks) {
    const StepDecision decision = decide(statuses);
    EXPECT_EQ(decision.take, take);
    if (!take) {
      EXPECT_EQ(decision.cause, cause);
    }
    EXPECT_EQ(decision.faulty_ranks, faulty_ranks);
  };
  expect({good}, true, {}, {});
  expect({good, good, good}, true, {}, {});
  expect({good, faulty, received_nan}, false, SkipCause::gradient, {1});
  expect({faulty, good, faulty}, false, SkipCause::gradient, {0, 2});
  expect({good, good, other}, false, SkipCause::message, {2});
  expect({received_nan, good, good}, false, SkipCause::message, {0});
  expect({good, other}, false, SkipCause::message, {0, 1});                             // no majority
  expect({received_nan, received_other_nan, received_nan}, false, SkipCause::sum, {});  // the bits of a NaN do not matter
  expect({received_nan}, false, SkipCause::sum, {});
}

}  // namespace
}  // namespace earshot::faults
