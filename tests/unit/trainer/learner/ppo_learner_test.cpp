// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "policy/action_distribution.h"
#include "tests/support/largest.h"
#include "tests/support/workers/hooked_collective.h"
#include "tests/support/workers/pointgoal_policy.h"
#include "tests/support/workers/two_workers.h"
#include "trainer/learner/ppo.h"

namespace earshot {
namespace {

constexpr int kHidden = 8;
const std::unique_ptr<Collective> kSingle = make_single_worker();
Collective& kAlone = *kSingle;

ActorCritic make_policy() {
  ActorCritic policy = pointgoal_policy(kHidden);
  const torch::NoGradGuard no_gradient;
  policy->named_parameters()["actor.weight"].mul_(50);  // distinct action probabilities
  return policy;
}

/// A rollout that `policy` could have made: random observations, rewards and episode ends.
RolloutBuffer make_rollout(ActorCritic policy, int num_steps, int num_envs, std::uint64_t seed, int max_steps = 0) {
  const torch::NoGradGuard no_gradient;
  torch::manual_seed(static_cast<std::int64_t>(seed));
  RolloutBuffer rollout(pointgoal_only(), std::max(max_steps, num_steps), num_envs, kHidden);
  torch::Tensor hidden = torch::randn({num_envs, kHidden}) * 0.3, not_done = torch::ones({num_envs});
  rollout.begin(hidden);
  const std::size_t B = static_cast<std::size_t>(num_envs);
  for (int t = 0; t < num_steps; ++t) {
    const ObservationTensors seen{{"pointgoal", torch::randn({num_envs, 2})}};
    const PolicyOutput output = policy->step(seen, hidden, not_done);
    const torch::Tensor actions = torch::randint(4, {num_envs}, torch::kInt64);
    rollout.push(seen, not_done, actions, log_probabilities(output.logits, actions), output.value);
    std::vector<float> rewards(B);
    std::vector<std::uint8_t> terminated(B), truncated(B), valid(B, 1);
    const torch::Tensor reward = torch::randn({num_envs}), event = torch::rand({num_envs});
    for (std::size_t b = 0; b < B; ++b) {
      rewards[b] = reward[static_cast<std::int64_t>(b)].item<float>();
      terminated[b] = event[static_cast<std::int64_t>(b)].item<float>() < 0.15f;
      truncated[b] = event[static_cast<std::int64_t>(b)].item<float>() > 0.85f;
    }
    rollout.push_outcome(rewards, terminated, truncated, torch::randn({num_envs}), valid);
    hidden = output.hidden;
    not_done = (event >= 0.15).logical_and(event <= 0.85).to(torch::kFloat32);
  }
  rollout.finish(torch::randn({num_envs}));
  return rollout;
}

/// The envs of two rollouts in one.
RolloutBuffer joined(ActorCritic policy, const RolloutBuffer& a, const RolloutBuffer& b) {
  RolloutBuffer both = make_rollout(policy, a.num_steps(), a.num_envs() + b.num_envs(), 0);
  both.observations.at("pointgoal") = torch::cat({a.observations["pointgoal"], b.observations["pointgoal"]}, 1);
  both.hidden = torch::cat({a.hidden, b.hidden}, 0);
  both.next_value = torch::cat({a.next_value, b.next_value}, 0);
  for (torch::Tensor RolloutBuffer::*slab :
       {&RolloutBuffer::not_done, &RolloutBuffer::actions, &RolloutBuffer::log_prob, &RolloutBuffer::values, &RolloutBuffer::rewards,
        &RolloutBuffer::terminated, &RolloutBuffer::truncated, &RolloutBuffer::final_values, &RolloutBuffer::valid, &RolloutBuffer::guided})
    both.*slab = torch::cat({a.*slab, b.*slab}, 1);
  return both;
}

PpoConfig one_minibatch() {
  PpoConfig config;
  config.epochs = config.minibatches = 1;
  return config;
}

torch::Tensor flat(const ActorCritic& policy) {
  std::vector<torch::Tensor> parts;
  for (const torch::Tensor& parameter : policy->parameters()) parts.push_back(parameter.detach().flatten());
  return torch::cat(parts);
}

/// Before it is summed over workers.
torch::Tensor gradient_of_first_minibatch(const RolloutBuffer& rollout, const PpoConfig& config, Collective& collective = kAlone) {
  PpoLearner learner(make_policy(), config, 1);
  torch::Tensor gradient;
  HookedCollective hooked(collective,
                          [&](std::span<float> buffer) {
                            if (!gradient.defined()) gradient = torch::tensor(torch::ArrayRef<float>(buffer.data(), buffer.size()));
                          },
                          {});
  learner.update(rollout, 0, 0, hooked);
  return gradient;
}

TEST(PpoLearner, TwoWorkersGiveTheGradientOfTheConcatenatedBatch) {
  const ActorCritic policy = make_policy();
  const RolloutBuffer a = make_rollout(policy, 7, 2, 1), b = make_rollout(policy, 7, 2, 2), both = joined(policy, a, b);
  const torch::Tensor of_a = gradient_of_first_minibatch(a, one_minibatch()), of_b = gradient_of_first_minibatch(b, one_minibatch());
  const torch::Tensor of_both = gradient_of_first_minibatch(both, one_minibatch());
  ASSERT_GT(largest(of_both), 0.1);
  EXPECT_LT(largest((of_a + of_b) / 2 - of_both), 1e-6);  // float32 sums of 14 and 28 rows, elements up to about 1
  // What a broadcast of rank 0, a sum, or an average of weights would give is another thing.
  EXPECT_GT(largest(of_a - of_both), 1e-2);
  EXPECT_GT(largest(of_a + of_b - of_both), 1e-2);
}

TEST(PpoLearner, AdvantagesAreNormalizedOverAllWorkers) {
  const ActorCritic policy = make_policy();
  RolloutBuffer a = make_rollout(policy, 7, 2, 1), b = make_rollout(policy, 7, 2, 2);
  b.rewards.add_(3);  // the means of the two differ
  const RolloutBuffer both = joined(policy, a, b);
  PpoConfig config = one_minibatch();
  config.normalize_advantages = true;

  TwoWorkers workers;
  std::array<torch::Tensor, 2> gradients;
  std::array<int, 2> calls{};
  std::array<double, 2> counted{};
  std::vector<std::thread> threads;
  for (int rank = 0; rank < 2; ++rank)
    threads.emplace_back([&, rank] {
      torch::set_num_threads(1);
      const auto r = static_cast<std::size_t>(rank);
      TwoWorkers::Worker worker = workers.worker(rank);
      gradients[r] = gradient_of_first_minibatch(rank == 0 ? a : b, config, worker);
      calls[r] = worker.double_sums;
      counted[r] = worker.first_sum;
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(calls, (std::array<int, 2>{2, 2}));
  EXPECT_EQ(counted, (std::array<double, 2>{28, 28}));
  const torch::Tensor of_both = gradient_of_first_minibatch(both, config);
  EXPECT_LT(largest((gradients[0] + gradients[1]) / 2 - of_both), 2e-6);
  const torch::Tensor each_its_own = (gradient_of_first_minibatch(a, config) + gradient_of_first_minibatch(b, config)) / 2;
  EXPECT_GT(largest(each_its_own - of_both), 1e-2);
}

// Eight steps and two of eight.  Truncated: the mean is five, so the eight count as five, and the two as they are.
TEST(PpoLearner, ShortRolloutsWeighAsConfigured) {
  struct Rule {
    PreemptWeight rule;
    std::array<double, 2> weights;
  };
  const std::array<RolloutBuffer, 2> rollouts{make_rollout(make_policy(), 8, 3, 1), make_rollout(make_policy(), 2, 3, 2, 8)};
  std::array<torch::Tensor, 2> whole;
  for (std::size_t r = 0; r < 2; ++r) whole[r] = gradient_of_first_minibatch(rollouts[r], one_minibatch());
  for (const Rule& rule :
       {Rule{PreemptWeight::sample, {1, 0.25}}, Rule{PreemptWeight::worker, {1, 1}}, Rule{PreemptWeight::truncated, {0.625, 0.25}}}) {
    PpoConfig config = one_minibatch();
    config.preempt_weight = rule.rule;
    TwoWorkers workers;
    std::array<torch::Tensor, 2> gradients;
    std::vector<std::thread> threads;
    for (std::size_t r = 0; r < 2; ++r)
      threads.emplace_back([&, r] {
        torch::set_num_threads(1);
        TwoWorkers::Worker worker = workers.worker(static_cast<int>(r));
        gradients[r] = gradient_of_first_minibatch(rollouts[r], config, worker);
      });
    for (std::thread& thread : threads) thread.join();
    for (std::size_t r = 0; r < 2; ++r) {
      EXPECT_EQ(whole[r][-1].item<float>(), 1) << "one worker alone";
      EXPECT_EQ(gradients[r][-1].item<double>(), rule.weights[r]);
      EXPECT_LT(largest(gradients[r] - rule.weights[r] * whole[r]), 1e-6);
    }
  }
}

TEST(PpoLearner, WholeRolloutsHaveTheSameBitsWithEachWeight) {
  const RolloutBuffer a = make_rollout(make_policy(), 7, 3, 1), b = make_rollout(make_policy(), 7, 3, 2);
  std::vector<torch::Tensor> weights;
  for (const PreemptWeight rule : {PreemptWeight::sample, PreemptWeight::worker, PreemptWeight::truncated}) {
    PpoConfig config;
    config.preempt_weight = rule;
    std::array<ActorCritic, 2> policies{make_policy(), make_policy()};
    TwoWorkers workers;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < 2; ++rank)
      threads.emplace_back([&, rank] {
        torch::set_num_threads(1);
        TwoWorkers::Worker worker = workers.worker(rank);
        PpoLearner(policies[static_cast<std::size_t>(rank)], config, 1).update(rank == 0 ? a : b, 0, 0, worker);
      });
    for (std::thread& thread : threads) thread.join();
    weights.push_back(flat(policies[0]));
  }
  EXPECT_TRUE(weights[1].equal(weights[0]));
  EXPECT_TRUE(weights[2].equal(weights[0]));
}

TEST(PpoLearner, WorkersKeepEqualWeights) {
  PpoConfig config;
  config.epochs = 3;
  config.minibatches = 4;
  std::array<ActorCritic, 2> policies{make_policy(), make_policy()};
  // Two and seven envs, rollouts of other lengths: the first worker has empty minibatches.
  const std::array<RolloutBuffer, 2> rollouts{make_rollout(policies[0], 5, 2, 1), make_rollout(policies[0], 9, 7, 2)};
  TwoWorkers workers;
  std::vector<std::thread> threads;
  for (int rank = 0; rank < 2; ++rank)
    threads.emplace_back([&, rank] {
      torch::set_num_threads(1);
      const auto r = static_cast<std::size_t>(rank);
      TwoWorkers::Worker worker = workers.worker(rank);
      PpoLearner(policies[r], config, 1).update(rollouts[r], 0, 0, worker);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_TRUE(flat(policies[0]).equal(flat(policies[1])));
  EXPECT_GT(largest(flat(policies[0]) - flat(make_policy())), 1e-4);
}

TEST(PpoLearner, EveryEnvIsInOneMinibatchPerEpochAndEveryMinibatchIsSummed) {
  PpoConfig config;
  config.epochs = 2;
  for (const auto& [num_envs, minibatches] : std::vector<std::pair<int, int>>{{3, 2}, {3, 5}, {4, 4}, {1, 3}}) {
    config.minibatches = minibatches;
    const RolloutBuffer rollout = make_rollout(make_policy(), 4, num_envs, 4);
    for (int env = 0; env < num_envs; ++env) {
      RolloutBuffer oracle_rows = rollout;
      oracle_rows.valid = torch::zeros_like(rollout.valid);
      oracle_rows.valid.select(1, env).fill_(1);
      int calls = 0, with_rows = 0;
      PpoLearner learner(make_policy(), config, 1);
      const std::size_t expected_size = static_cast<std::size_t>(make_policy()->num_parameters()) + 1;
      HookedCollective counted([&](std::span<float> buffer) {
        ++calls;
        EXPECT_EQ(buffer.size(), expected_size);
        with_rows += buffer.back() > 0;
      });
      learner.update(oracle_rows, 0, 0, counted);
      EXPECT_EQ(calls, 2 * minibatches);
      EXPECT_EQ(with_rows, 2) << "env " << env << " of " << num_envs << " in " << minibatches;  // once per epoch
    }
  }
}

TEST(PpoLearner, AWorkerWithoutRowsHasNoSay) {
  const RolloutBuffer rollout = make_rollout(make_policy(), 6, 3, 5);
  ActorCritic alone = make_policy(), with_idle_peer = make_policy(), idle = make_policy();
  PpoLearner(alone, one_minibatch(), 1).update(rollout, 0, 0, kAlone);
  HookedCollective idle_peer([](std::span<float> buffer) {
    for (float& element : buffer) element += 0.f;  // the peer's zeros, its weight among them
  });
  PpoLearner(with_idle_peer, one_minibatch(), 1).update(rollout, 0, 0, idle_peer);
  EXPECT_LT(largest(flat(alone) - flat(with_idle_peer)), 1e-9);
  // A peer with the same rows doubles the sum and the weight.
  ActorCritic with_equal_peer = make_policy();
  HookedCollective equal_peer([](std::span<float> buffer) {
    for (float& element : buffer) element *= 2;
  });
  PpoLearner(with_equal_peer, one_minibatch(), 1).update(rollout, 0, 0, equal_peer);
  EXPECT_TRUE(flat(alone).equal(flat(with_equal_peer)));  // powers of two do not round

  RolloutBuffer no_rows = rollout;
  no_rows.valid = torch::zeros_like(rollout.valid);
  const UpdateStats stats = PpoLearner(idle, one_minibatch(), 1).update(no_rows, 0, 0, kAlone);
  EXPECT_TRUE(flat(idle).equal(flat(make_policy())));
  EXPECT_EQ(stats.skipped_steps, 0);
  EXPECT_EQ(stats.policy_loss, 0);
  EXPECT_TRUE(std::isnan(stats.explained_variance));
}

TEST(PpoLearner, AGradientThatIsNotFiniteMovesNothing) {
  PpoConfig config;  // 2 epochs of 2 minibatches
  for (const float poison : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    for (const bool first : {true, false}) {
      ActorCritic policy = make_policy();
      PpoLearner learner(policy, config, 1);
      learner.update(make_rollout(policy, 6, 4, 6), 0, 0, kAlone);  // Adam has moments now, which would move the weights on their own
      const RolloutBuffer rollout = make_rollout(policy, 6, 4, 6);
      const torch::Tensor before = flat(policy).clone();
      HookedCollective always([&](std::span<float> buffer) { (first ? buffer.front() : buffer[buffer.size() - 2]) = poison; });
      UpdateStats stats = learner.update(rollout, 0, 1, always);
      EXPECT_EQ(stats.skipped_steps, 4);
      EXPECT_EQ(stats.non_finite_here, 0);  // it came from elsewhere
      EXPECT_TRUE(flat(policy).equal(before));

      int calls = 0;
      HookedCollective once([&](std::span<float> buffer) {
        if (++calls == 2) buffer[3] = poison;
      });
      stats = learner.update(rollout, 0, 2, once);
      EXPECT_EQ(stats.skipped_steps, 1);
      EXPECT_TRUE(torch::isfinite(flat(policy)).all().item<bool>());
      EXPECT_FALSE(flat(policy).equal(before));
    }
  }
}

TEST(PpoLearner, NamesItselfAsTheFaultyRank) {
  ActorCritic policy = make_policy();
  RolloutBuffer rollout = make_rollout(policy, 6, 2, 7);
  rollout.rewards[2][0] = std::numeric_limits<float>::quiet_NaN();
  const UpdateStats stats = PpoLearner(policy, one_minibatch(), 1).update(rollout, 0, 0, kAlone);
  EXPECT_EQ(stats.skipped_steps, 1);
  EXPECT_EQ(stats.non_finite_here, 1);
  EXPECT_TRUE(flat(policy).equal(flat(make_policy())));
}

TEST(PpoLearner, ClipsTheGlobalNormAtAnyScale) {
  const RolloutBuffer rollout = make_rollout(make_policy(), 6, 3, 8);
  const torch::Tensor gradient = gradient_of_first_minibatch(rollout, one_minibatch());
  const double norm = gradient.slice(0, 0, -1).to(torch::kFloat64).norm().item<double>();
  struct Setting {
    double max_norm, scale, expected;
  };
  // 1e30 squared overflows float32; a limit above the norm leaves the gradient alone.
  for (const Setting& s : {Setting{0.01, 1, 0.01}, Setting{0.2, 1e30, 0.2}, Setting{1e3, 1, norm}, Setting{1e3, 1e-3, norm * 1e-3}}) {
    PpoConfig config = one_minibatch();
    config.max_gradient_norm = s.max_norm;
    ActorCritic policy = make_policy();
    PpoLearner learner(policy, config, 1);
    HookedCollective scaled([&](std::span<float> buffer) {
      for (float& element : buffer.first(buffer.size() - 1)) element *= static_cast<float>(s.scale);
    });
    const UpdateStats stats = learner.update(rollout, 0, 0, scaled);
    EXPECT_NEAR(stats.gradient_norm, norm * s.scale, 1e-5 * norm * s.scale);
    // The first moment of Adam after one step is (1 - 0.9) times what it was given.
    double moment = 0;
    for (const auto& [key, state] : learner.optimizer().state())
      moment += static_cast<const torch::optim::AdamParamState&>(*state).exp_avg().to(torch::kFloat64).square().sum().item<double>();
    EXPECT_NEAR(std::sqrt(moment) / 0.1, s.expected, 1e-4 * s.expected) << s.max_norm << " " << s.scale;
  }
}

TEST(PpoLearner, StepsAsAdamDoesWithTheDecayedRate) {
  const RolloutBuffer rollout = make_rollout(make_policy(), 6, 3, 9);
  PpoConfig config = one_minibatch();
  config.max_gradient_norm = 1e6;
  config.learning_rate = 1e-2;
  const torch::Tensor g = gradient_of_first_minibatch(rollout, config).slice(0, 0, -1).to(torch::kFloat64);
  const torch::Tensor start = flat(make_policy()).to(torch::kFloat64);
  for (const bool decay : {false, true})
    for (const double progress : {0.0, 0.25, 1.0, 1.5}) {
      config.linear_learning_rate_decay = decay;
      ActorCritic policy = make_policy();
      PpoLearner(policy, config, 1).update(rollout, progress, 0, kAlone);
      // After one step both moments' bias corrections cancel: lr g / (|g| + eps).
      const double rate = 1e-2 * (decay ? std::max(0.0, 1 - progress) : 1.0);
      EXPECT_LT(largest(flat(policy).to(torch::kFloat64) - (start - rate * g / (g.abs() + 1e-5))), 1e-6) << progress;
    }
}

TEST(PpoLearner, ClipDecaysWithProgress) {
  PpoConfig config = one_minibatch();
  config.epochs = 2;
  config.learning_rate = 3e-2;
  config.linear_clip_decay = true;
  const auto clip_fraction = [&](double progress) {
    ActorCritic policy = make_policy();
    return PpoLearner(policy, config, 1).update(make_rollout(policy, 8, 4, 10), progress, 0, kAlone).clip_fraction;
  };
  EXPECT_LT(clip_fraction(0), clip_fraction(0.99));  // 0.2 against 0.002
}

TEST(PpoLearner, RecomputesWhatActed) {
  ActorCritic policy = make_policy();
  RolloutBuffer rollout = make_rollout(policy, 10, 4, 11);
  EXPECT_LT(PpoLearner(policy, PpoConfig{}, 1).update(rollout, 0, 0, kAlone).max_ratio_error, 1e-5);
  ActorCritic again = make_policy();
  rollout = make_rollout(again, 10, 4, 11);
  rollout.hidden = torch::zeros_like(rollout.hidden);  // the wrong state at the start
  EXPECT_GT(PpoLearner(again, PpoConfig{}, 1).update(rollout, 0, 0, kAlone).max_ratio_error, 1e-3);
}

TEST(PpoLearner, ReadsNoRowPastTheEnd) {
  ActorCritic first_policy = make_policy(), second_policy = make_policy();
  const RolloutBuffer exact = make_rollout(first_policy, 3, 4, 12);
  RolloutBuffer longer = make_rollout(second_policy, 3, 4, 12, 8);
  for (torch::Tensor* slab : {&longer.observations.at("pointgoal"), &longer.not_done, &longer.log_prob, &longer.values, &longer.rewards,
                              &longer.final_values, &longer.terminated, &longer.truncated, &longer.valid, &longer.guided})
    slab->slice(0, 3).fill_(std::numeric_limits<float>::quiet_NaN());
  PpoLearner(first_policy, PpoConfig{}, 1).update(exact, 0, 0, kAlone);
  PpoLearner(second_policy, PpoConfig{}, 1).update(longer, 0, 0, kAlone);
  EXPECT_TRUE(flat(first_policy).equal(flat(second_policy)));
  EXPECT_FALSE(flat(first_policy).equal(flat(make_policy())));
}

TEST(PpoLearner, IsAFunctionOfItsInputs) {
  const RolloutBuffer rollout = make_rollout(make_policy(), 6, 6, 13);
  const auto weights_after = [&](std::uint64_t seed, std::uint64_t update) {
    ActorCritic policy = make_policy();
    torch::manual_seed(static_cast<std::int64_t>(seed * 100 + update));
    PpoLearner(policy, PpoConfig{}, seed).update(rollout, 0, update, kAlone);
    return flat(policy);
  };
  EXPECT_TRUE(weights_after(1, 4).equal(weights_after(1, 4)));
  // Other permutations; one pair may agree by chance (one in ten splits of six envs), five in a row do not.
  bool differs_by_update = false, differs_by_seed = false;
  for (std::uint64_t i = 5; i < 10; ++i) {
    differs_by_update |= !weights_after(1, i).equal(weights_after(1, 4));
    differs_by_seed |= !weights_after(i, 4).equal(weights_after(1, 4));
  }
  EXPECT_TRUE(differs_by_update);
  EXPECT_TRUE(differs_by_seed);
}

TEST(PpoLearner, ReportsExplainedVariance) {
  ActorCritic policy = make_policy();
  RolloutBuffer rollout = make_rollout(policy, 2, 2, 14);
  // Every row ends its episode, so the returns are the rewards: 1, 2, 3, 4 (variance 1.25).  Values 1, 2, 3, 6: R - V = 0, 0, 0, -2 with
  // mean -0.5 and variance 3 (0.25) / 4 + 2.25 / 4 = 0.75.
  rollout.terminated.fill_(1);
  rollout.rewards.copy_(torch::tensor({{1.f, 2.f}, {3.f, 4.f}}));
  rollout.values.copy_(torch::tensor({{1.f, 2.f}, {3.f, 6.f}}));
  EXPECT_NEAR(PpoLearner(policy, one_minibatch(), 1).update(rollout, 0, 0, kAlone).explained_variance, 1 - 0.75 / 1.25, 1e-9);
  rollout.rewards.fill_(1);
  policy = make_policy();  // the one that the rollout is of
  EXPECT_TRUE(std::isnan(PpoLearner(policy, one_minibatch(), 1).update(rollout, 0, 0, kAlone).explained_variance));
}

}  // namespace
}  // namespace earshot
