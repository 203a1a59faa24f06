// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "policy/action_distribution.h"
#include "sim/base/random.h"
#include "tests/support/workers/hooked_collective.h"
#include "tests/support/workers/pointgoal_policy.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/learner/ppo.h"

namespace earshot::faults {

constexpr int kWorkers = 3, kEnvs = 4, kSteps = 5, kHidden = 8;
constexpr int kFirst = 0, kMiddle = 1, kLast = 2;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();

/// When a seam is open.  minibatch counts over the epochs of one update.
struct Moment {
  int rank = 0, update = 0, minibatch = 0;
};

/// Where a test reaches into a worker; empty seams leave it alone.
struct Seams {
  std::function<void(const Moment&, RolloutBuffer&)> rollout;     ///< what was collected, before it is learned from
  std::function<void(const Moment&, PolicyOutput&)> output;       ///< what the network says of a minibatch
  std::function<void(const Moment&, torch::Tensor&)> gradient;    ///< of the actor's weight, within backward
  std::function<void(const Moment&, std::span<float>)> sent;      ///< the flat gradient, before the collective
  std::function<void(const Moment&, std::span<float>)> received;  ///< the sum, after it
};

inline PolicyConfig small_policy() {
  PolicyConfig config;
  config.hidden_size = kHidden;
  config.seed = 3;
  return config;
}

inline PpoConfig two_by_two() {
  PpoConfig config;  // two epochs of two minibatches
  config.learning_rate = 1e-2;
  return config;
}

/// A policy whose learner-side output passes through a seam.
class HookedPolicy : public ActorCriticImpl {
 public:
  HookedPolicy() : ActorCriticImpl(pointgoal_only(), small_policy()) {}
  std::function<void(PolicyOutput&)> hook;
  PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) override {
    PolicyOutput output = ActorCriticImpl::sequence(observations, hidden, not_done);
    if (hook) hook(output);
    return output;
  }
};

/// Uniform in [-1, 1], a function of the key: threads share no generator.
inline torch::Tensor noise(torch::IntArrayRef shape, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  torch::Tensor tensor = torch::empty(shape);
  const RandomStream random(17, Purpose::test, a, b, c);
  float* values = tensor.data_ptr<float>();
  for (std::int64_t i = 0; i < tensor.numel(); ++i) values[i] = static_cast<float>(2 * random.uniform(static_cast<std::uint32_t>(i)) - 1);
  return tensor;
}

/// A rollout of `policy` in envs that are noise; an episode ends now and then.
inline RolloutBuffer collect(ActorCritic& policy, int rank, int update) {
  const torch::NoGradGuard no_gradient;
  const auto r = static_cast<std::uint32_t>(rank), u = static_cast<std::uint32_t>(update);
  RolloutBuffer rollout(pointgoal_only(), kSteps, kEnvs, kHidden);
  torch::Tensor hidden = 0.3 * noise({kEnvs, kHidden}, r, u, 1000), not_done = torch::ones({kEnvs});
  rollout.begin(hidden);
  for (int t = 0; t < kSteps; ++t) {
    const auto key = static_cast<std::uint32_t>(10 * t);
    const ObservationTensors seen{{"pointgoal", noise({kEnvs, 2}, r, u, key)}};
    const PolicyOutput output = policy->step(seen, hidden, not_done);
    const torch::Tensor actions = (2 * noise({kEnvs}, r, u, key + 1) + 2).floor().clamp(0, 3).to(torch::kInt64);
    rollout.push(seen, not_done, actions, log_probabilities(output.logits, actions), output.value);
    const torch::Tensor reward = noise({kEnvs}, r, u, key + 2), event = noise({kEnvs}, r, u, key + 3);
    std::vector<float> rewards(kEnvs);
    std::vector<std::uint8_t> terminated(kEnvs), truncated(kEnvs), valid(kEnvs, 1);
    for (int env = 0; env < kEnvs; ++env) {
      const auto i = static_cast<std::size_t>(env);
      rewards[i] = reward[env].item<float>();
      terminated[i] = event[env].item<float>() < -0.8f;
      truncated[i] = event[env].item<float>() > 0.8f;
    }
    rollout.push_outcome(rewards, terminated, truncated, noise({kEnvs}, r, u, key + 4), valid);
    hidden = output.hidden;
    not_done = (event.abs() <= 0.8).to(torch::kFloat32);
  }
  rollout.finish(noise({kEnvs}, r, u, 2000));
  return rollout;
}

/// What a worker ends with.
struct Outcome {
  std::map<std::string, torch::Tensor> weights, adam;
  std::vector<UpdateStats> updates;
};

/// One worker's part of `updates` updates.
inline Outcome work(Collective& collective, const PpoConfig& config, int updates, const Seams& seams) {
  torch::set_num_threads(1);
  Moment moment{.rank = collective.identity().rank};
  bool learning = false;
  const auto hooked_policy = std::make_shared<HookedPolicy>();
  hooked_policy->hook = [&](PolicyOutput& output) {
    if (learning && seams.output) seams.output(moment, output);
  };
  ActorCritic policy(std::static_pointer_cast<ActorCriticImpl>(hooked_policy));
  {
    const torch::NoGradGuard no_gradient;
    policy->named_parameters()["actor.weight"].mul_(50);  // distinct action probabilities
  }
  policy->named_parameters()["actor.weight"].register_hook([&](torch::Tensor gradient) {
    torch::Tensor changed = gradient.clone();
    if (seams.gradient) seams.gradient(moment, changed);
    return changed;
  });
  PpoLearner learner(policy, config, 1);
  HookedCollective hooked(
      collective,
      [&](std::span<float> buffer) {
        if (seams.sent) seams.sent(moment, buffer);
      },
      [&](std::span<float> buffer) {
        if (seams.received) seams.received(moment, buffer);
        ++moment.minibatch;
      });
  Outcome outcome;
  for (moment.update = 0; moment.update < updates; ++moment.update) {
    moment.minibatch = 0;
    learning = false;
    RolloutBuffer rollout = collect(policy, moment.rank, moment.update);
    if (seams.rollout) seams.rollout(moment, rollout);
    learning = true;
    outcome.updates.push_back(learner.update(rollout, 0, static_cast<std::uint64_t>(moment.update), hooked));
  }
  outcome.weights = weights_of(policy);
  outcome.adam = optimizer_state_of(policy, learner.optimizer());
  return outcome;
}

/// All workers in threads of this process, over the real ring; by rank.
inline std::vector<Outcome> work_together(const PpoConfig& config, int updates, const Seams& seams, int workers = kWorkers) {
  const PrivateTestFolder folder;
  std::vector<Outcome> outcomes(static_cast<std::size_t>(workers));
  std::vector<std::string> errors(outcomes.size());
  std::vector<std::thread> threads;
  for (int rank = 0; rank < workers; ++rank)
    threads.emplace_back([&, rank] {
      const auto r = static_cast<std::size_t>(rank);
      try {
        const auto ring = make_zmq_ring(ring_in(folder, rank, workers));
        outcomes[r] = work(*ring, config, updates, seams);
      } catch (const std::exception& error) {
        errors[r] = error.what();
      }
    });
  for (std::thread& thread : threads) thread.join();
  for (const std::string& error : errors) EXPECT_EQ(error, "");
  return outcomes;
}

inline bool same_bits(const std::map<std::string, torch::Tensor>& a, const std::map<std::string, torch::Tensor>& b) {
  if (a.size() != b.size() || a.empty()) return false;
  for (const auto& [name, tensor] : a) {
    const torch::Tensor x = tensor.contiguous(), y = b.at(name).contiguous();
    if (x.nbytes() != y.nbytes() || std::memcmp(x.data_ptr(), y.data_ptr(), x.nbytes()) != 0) return false;
  }
  return true;
}

inline bool all_finite(const std::map<std::string, torch::Tensor>& tensors) {
  for (const auto& [name, tensor] : tensors)
    if (!torch::isfinite(tensor).all().item<bool>()) return false;
  return true;
}

/// Weights and Adam's state: finite, and the same bits on every worker.
inline void expect_clean_and_equal(const std::vector<Outcome>& outcomes) {
  for (const Outcome& outcome : outcomes) {
    EXPECT_TRUE(all_finite(outcome.weights));
    EXPECT_TRUE(all_finite(outcome.adam));
    EXPECT_TRUE(same_bits(outcome.weights, outcomes[0].weights));
    EXPECT_TRUE(same_bits(outcome.adam, outcomes[0].adam));
  }
}

}  // namespace earshot::faults
