// SPDX-License-Identifier: Apache-2.0
// What is not finite is stopped where it would enter: before the policy sees it (Actor), before the learner has it (RolloutBuffer, gae).
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "tests/support/workers/fault_bench.h"
#include "trainer/learner/gae.h"
#include "trainer/rollout/actor.h"

namespace earshot::faults {
namespace {

ObservationTensors goals(const torch::Tensor& pointgoal) { return {{"pointgoal", pointgoal}}; }

std::vector<std::uint8_t> sanitized_of(const Actor& actor) { return {actor.sanitized().begin(), actor.sanitized().end()}; }

TEST(G9_Observation, ThatIsNotFiniteIsZeroedMarkedAndReachesNoOtherRow) {
  for (const float bad : {kNan, kInfinity, -kInfinity}) {
    ActorCritic policy(pointgoal_only(), small_policy());
    Actor actor(policy, 0, kEnvs), clean(policy, 0, kEnvs);
    const torch::Tensor good = noise({kEnvs, 2}, 1, 1, 1);
    torch::Tensor faulty = good.clone(), zeroed = good.clone();
    faulty[1][1] = bad;
    zeroed[1].zero_();
    const PolicyOutput& output = actor.observe(goals(faulty));
    EXPECT_EQ(sanitized_of(actor), (std::vector<std::uint8_t>{0, 1, 0, 0}));
    EXPECT_EQ(actor.sanitized_rows(), 1u);
    EXPECT_TRUE(actor.seen()["pointgoal"].equal(zeroed));
    EXPECT_FALSE(torch::isfinite(faulty).all().item<bool>());  // the env's own buffer was not written to
    const PolicyOutput& expected = clean.observe(goals(zeroed));
    EXPECT_TRUE(output.logits.equal(expected.logits) && output.hidden.equal(expected.hidden));
    const torch::Tensor others = torch::tensor({0, 2, 3});
    EXPECT_TRUE(output.value.index_select(0, others).equal(expected.value.index_select(0, others)));
    EXPECT_TRUE(std::isnan(output.value[1].item<float>()));  // the value of zeros belongs to no state: the row before must not lead to it
    actor.observe(goals(good));
    EXPECT_EQ(sanitized_of(actor), (std::vector<std::uint8_t>(kEnvs, 0)));
  }
}

/// Says NaN once, as weights and a state can that overflow.
class StumblingPolicy : public ActorCriticImpl {
 public:
  StumblingPolicy() : ActorCriticImpl(pointgoal_only(), small_policy()) {}
  int stumbles = 0;
  PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) override {
    PolicyOutput output = ActorCriticImpl::sequence(observations, hidden, not_done);
    if (stumbles-- > 0) output.hidden[2][3] = kNan;
    return output;
  }
};

// NaN in a hidden state would stay for ever: 0 * NaN is NaN, so not even the next episode would be rid of it.
TEST(G9_HiddenState, ThatIsNotFiniteBeginsAnew) {
  const auto stumbling = std::make_shared<StumblingPolicy>();
  ActorCritic policy(std::static_pointer_cast<ActorCriticImpl>(stumbling));
  Actor actor(policy, 0, kEnvs), expected(policy, 0, kEnvs);
  const torch::Tensor hidden = noise({kEnvs, kHidden}, 3, 3, 3), ones = torch::ones({kEnvs}), seen = noise({kEnvs, 2}, 4, 4, 4);
  actor.restore(hidden, ones);
  stumbling->stumbles = 1;
  const PolicyOutput output = actor.observe(goals(seen));
  EXPECT_EQ(sanitized_of(actor), (std::vector<std::uint8_t>{0, 0, 1, 0}));
  EXPECT_EQ(actor.not_done()[2].item<float>(), 0.f);  // so the learner, too, begins anew there
  torch::Tensor zeroed = seen.clone(), begins = ones.clone();
  zeroed[2].zero_();
  begins[2] = 0;
  expected.restore(hidden, begins);
  EXPECT_TRUE(output.hidden.equal(expected.observe(goals(zeroed)).hidden));
  EXPECT_TRUE(torch::isfinite(output.hidden).all().item<bool>());
}

TEST(G7_Sampling, FromWeightsThatAreNotFiniteIsRefusedAndNamesTheEnv) {
  ActorCritic policy(pointgoal_only(), small_policy());
  {
    const torch::NoGradGuard no_gradient;
    policy->named_parameters()["actor.bias"][1] = kNan;
  }
  Actor actor(policy, 0, kEnvs);
  const PolicyOutput& output = actor.observe(goals(noise({kEnvs, 2}, 5, 5, 5)));
  const std::vector<ActingEnv> acting_envs{{7, 1, 2}, {8, 1, 2}, {9, 1, 2}, {10, 1, 2}};
  std::vector<std::int32_t> actions(kEnvs);
  try {
    sample_actions(output.logits, acting_envs, 1, actions);
    FAIL() << "sampled";
  } catch (const RunError& error) {
    EXPECT_NE(std::string(error.what()).find("env 7, episode 1, step 2"), std::string::npos) << error.what();
  }
}

/// Pushes one row of zeros but for what `change` puts in; returns the buffer after that row.
struct Row {
  std::vector<float> rewards = std::vector<float>(kEnvs, 1.f);
  torch::Tensor value = torch::full({kEnvs}, 2.f), log_prob = torch::full({kEnvs}, -1.f), final_value = torch::full({kEnvs}, 3.f);
  std::vector<std::uint8_t> terminated = std::vector<std::uint8_t>(kEnvs, 0), truncated = std::vector<std::uint8_t>(kEnvs, 0),
                            valid = std::vector<std::uint8_t>(kEnvs, 1);
  void push_to(RolloutBuffer& rollout) const {
    rollout.push(goals(torch::zeros({kEnvs, 2})), torch::ones({kEnvs}), torch::zeros({kEnvs}, torch::kInt64), log_prob, value);
    rollout.push_outcome(rewards, terminated, truncated, final_value, valid);
  }
};

TEST(G9_RolloutRow, ThatIsNotFiniteIsLeftOutAndCounted) {
  for (const float bad : {kNan, kInfinity, -kInfinity}) {
    RolloutBuffer rollout(pointgoal_only(), 8, kEnvs, kHidden);
    rollout.begin(torch::zeros({kEnvs, kHidden}));
    Row reward, value, log_prob, final_value, unused, idle;
    reward.rewards[0] = bad;
    value.value[1] = bad;
    log_prob.log_prob[2] = bad;
    final_value.final_value[3] = bad;
    final_value.truncated[3] = 1;
    unused.final_value[0] = bad;  // no end of time: gae() does not read it
    idle.rewards[1] = bad;        // did not count before
    idle.valid[1] = 0;
    for (const Row* row : {&reward, &value, &log_prob, &final_value, &unused, &idle}) row->push_to(rollout);
    EXPECT_EQ(rollout.dropped_rows(), 5u);
    torch::Tensor expected = torch::ones({8, kEnvs});
    for (int i = 0; i < 4; ++i) expected[i][i] = 0;
    expected[0][1] = 0;  // what followed it was the value that is not known
    expected[5][1] = 0;
    EXPECT_TRUE(rollout.valid.slice(0, 0, 6).equal(expected.slice(0, 0, 6)));
    for (const torch::Tensor* slab : {&rollout.rewards, &rollout.values, &rollout.log_prob})
      EXPECT_TRUE(torch::isfinite(*slab).all().item<bool>());
    torch::Tensor next = torch::zeros({kEnvs});
    next[2] = bad;
    rollout.finish(next);
    EXPECT_EQ(rollout.dropped_rows(), 6u);
    EXPECT_EQ(rollout.valid[5][2].item<float>(), 0.f);
    EXPECT_TRUE(torch::isfinite(rollout.next_value).all().item<bool>());
  }
}

// gamma = lambda = 1/2; rewards 1, 2, 3; values 2, 4, 8; 16 follows.  The step of the second row is not known:
// A2 = 3 + 16/2 - 8 = 3;  A1 = 0;  A0 = 1 + 4/2 - 2 = 1: it still leads to a state worth 4, and the chain ends there.
TEST(G9_QuarantinedRow, CutsTheChainAndHasNoAdvantage) {
  const auto column = [](const std::vector<double>& values) { return torch::tensor(values, torch::kFloat64).unsqueeze(1); };
  const GaeConfig half{.gamma = 0.5, .lambda = 0.5};
  const torch::Tensor zeros = column({0, 0, 0}), next = torch::tensor({16.0}, torch::kFloat64), valid = column({1, 0, 1});
  const auto expect = [&](const torch::Tensor& rewards, const torch::Tensor& truncated, const torch::Tensor& final_values) {
    const torch::Tensor advantages = gae(rewards, column({2, 4, 8}), zeros, truncated, final_values, next, half, valid);
    EXPECT_TRUE(advantages.equal(column({1, 0, 3}))) << advantages;
  };
  expect(column({1, 2, 3}), zeros, zeros);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expect(column({1, nan, 3}), column({0, 1, 0}),
         column({0, nan, 0}));  // as a quarantined step ends: truncated, and nothing to bootstrap from
}

// The same faults as in the matrix, but where they come in for real: through the buffer.  The rows are left out, no step is skipped, and
// the weights are those of a run that never had the rows.
TEST(G9_RolloutRow, LeavesNoOtherTrace) {
  const auto seams_with = [](float bad) {
    Seams seams;
    seams.rollout = [bad](const Moment& now, RolloutBuffer& rollout) {
      if (now.update != 1 + now.rank) return;
      RolloutBuffer again(pointgoal_only(), kSteps, kEnvs, kHidden);
      again.begin(rollout.hidden);
      const auto bytes = [](const torch::Tensor& row) {
        const torch::Tensor flags = row.to(torch::kUInt8);
        return std::vector<std::uint8_t>(flags.data_ptr<std::uint8_t>(), flags.data_ptr<std::uint8_t>() + flags.numel());
      };
      for (int t = 0; t < kSteps; ++t) {
        again.push(goals(rollout.observations["pointgoal"][t]), rollout.not_done[t], rollout.actions[t], rollout.log_prob[t],
                   rollout.values[t]);
        std::vector<float> rewards(rollout.rewards[t].data_ptr<float>(), rollout.rewards[t].data_ptr<float>() + kEnvs);
        std::vector<std::uint8_t> valid = bytes(rollout.valid[t]);
        if (t == 2) {
          rewards[1] = bad;
          if (std::isfinite(bad)) valid[1] = 0;
        }
        again.push_outcome(rewards, bytes(rollout.terminated[t]), bytes(rollout.truncated[t]), rollout.final_values[t], valid);
      }
      again.finish(rollout.next_value);
      rollout = again;
    };
    return work_together(two_by_two(), kWorkers + 2, seams);
  };
  const std::vector<Outcome> with_nan = seams_with(kNan), masked = seams_with(12345.f);
  for (const Outcome& outcome : with_nan)
    for (const UpdateStats& stats : outcome.updates) EXPECT_EQ(stats.skipped_steps, 0);
  EXPECT_TRUE(same_bits(with_nan[0].weights, masked[0].weights));
  EXPECT_FALSE(same_bits(with_nan[0].weights, work_together(two_by_two(), kWorkers + 2, {})[0].weights));
  expect_clean_and_equal(with_nan);
}

}  // namespace
}  // namespace earshot::faults
