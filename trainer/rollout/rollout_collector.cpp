// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/rollout_collector.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "policy/action_distribution.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

template <class T>
std::span<const T> part_of(std::span<const T> all, int first, int count) {
  return all.subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(count));
}

}  // namespace

RolloutCollector::RolloutCollector(const RolloutConfig& config, BatchedEnv& env, PolicyNetwork policy, int first_env)
    : config_(config),
      env_(env),
      first_env_(first_env),
      rollout_(config.sensors, config.rollout_steps, env.num_envs(), policy->hidden_size()),
      oracle_acted_(static_cast<std::size_t>(env.num_envs()), 0) {
  const int num_parts = config.overlap ? 2 : 1;
  for (int i = 0; i < num_parts; ++i) {
    const int first = i * env.num_envs() / num_parts, count = (i + 1) * env.num_envs() / num_parts - first;
    parts_.push_back({.first = first,
                      .count = count,
                      .actor = Actor(policy, first, count),
                      .rollout = rollout_.columns(first, count),
                      .envs = std::vector<std::int32_t>(static_cast<std::size_t>(count)),
                      .actions = std::vector<std::int32_t>(static_cast<std::size_t>(count)),
                      .acting = std::vector<ActingEnv>(static_cast<std::size_t>(count))});
    std::iota(parts_.back().envs.begin(), parts_.back().envs.end(), first);
  }
}

void RolloutCollector::collect(double progress, EpisodeSums& finished, StageTimes& times, const std::function<bool(int step)>& in_step) {
  const StageTimes before = StageTimes::of(env_.counters().stages);
  LapTimer watch;
  double env_s = 0;
  for (Part& part : parts_) part.rollout.begin(part.actor.hidden());
  // A part whose action is chosen is sent at once; the others are on their way meanwhile.
  const bool together = parts_.size() == 1;
  const auto start = [&](Part& part) {
    act(part, progress);
    times.policy += watch.lap();
    if (together)
      env_.step(part.actions);
    else
      env_.send(part.envs, part.actions);
    env_s += watch.lap();
  };
  for (Part& part : parts_) start(part);
  int steps = 0;
  for (bool last = false; !last; ++steps) {
    last = in_step && in_step(steps);
    last = last || steps + 1 == config_.rollout_steps;
    for (Part& part : parts_) {
      if (!together) env_.recv(part.count, RecvOrder::as_sent);
      env_s += watch.lap();
      note_outcome(part, finished);
      times.policy += watch.lap();
      if (!last) start(part);
    }
  }
  for (Part& part : parts_) part.rollout.finish(part.actor.peek_value(env_));
  rollout_.columns_are_filled(steps);
  times.policy += watch.lap();

  // Stage seconds are summed over the env's threads; scaled to wall time they add up with the other stages.
  StageTimes stages = StageTimes::of(env_.counters().stages);
  stages.add(before, -1.0);
  if (stages.total() > 0) times.add(stages, env_s / stages.total());
}

void RolloutCollector::act(Part& part, double progress) {
  const PolicyOutput& output = part.actor.observe(env_);
  const torch::Tensor not_done = part.actor.not_done().clone();
  for (std::size_t i = 0; i < part.acting.size(); ++i) {
    const int env = part.envs[i];
    const AgentPlace place = env_.agent(env);
    part.acting[i] = {static_cast<std::uint32_t>(first_env_ + env), static_cast<std::uint32_t>(place.episode_count),
                      static_cast<std::uint32_t>(place.episode_step)};
  }
  sample_actions(output.logits, part.acting, config_.seed, part.actions);
  const torch::Tensor guided = take_oracle_actions(part, progress);
  const torch::Tensor taken = torch::tensor(std::vector<std::int64_t>(part.actions.begin(), part.actions.end()));
  part.rollout.push(part.actor.seen(), not_done, taken, log_probabilities(output.logits, taken), output.value, guided);
}

/// Puts the oracle's actions in where it acts, and returns a 1 for those; undefined where it acts nowhere.  Which episodes: by a draw per
/// episode, so that it hands over to the policy once and for good as the training goes on.
torch::Tensor RolloutCollector::take_oracle_actions(Part& part, double progress) {
  const double fraction = config_.guidance.oracle_at(progress);
  if (fraction <= 0) return {};
  torch::Tensor guided = torch::zeros({part.count});
  const torch::Tensor& oracle = part.actor.seen()["oracle_action"];
  for (std::size_t i = 0; i < part.actions.size(); ++i) {
    if (part.actor.sanitized()[i] != 0) continue;  // the label is gone with the rest of the row
    const ActingEnv& acting = part.acting[i];
    if (RandomStream(config_.seed, Purpose::oracle_episode, acting.env, acting.episode).uniform(0) >= fraction) continue;
    part.actions[i] = oracle.data_ptr<std::int32_t>()[i];
    guided[static_cast<std::int64_t>(i)] = 1;
    oracle_acted_[static_cast<std::size_t>(part.envs[i])] = 1;
  }
  return guided;
}

void RolloutCollector::note_outcome(Part& part, EpisodeSums& finished) {
  part.rollout.push_outcome(part_of(env_.rewards(), part.first, part.count), part_of(env_.terminated(), part.first, part.count),
                            part_of(env_.truncated(), part.first, part.count), part.actor.truncated_values(env_), experience(part));
  part.actor.advance(env_);
  for (const FinishedEpisode& episode : env_.finished()) {
    std::uint8_t& by_oracle = oracle_acted_[static_cast<std::size_t>(episode.env - first_env_)];
    if (by_oracle == 0) finished.add(episode.metrics);
    by_oracle = 0;
  }
  for (const std::int32_t env : part.envs)  // an episode that was quarantined is not among the finished
    if (env_.quarantined()[static_cast<std::size_t>(env)] != 0) oracle_acted_[static_cast<std::size_t>(env)] = 0;
}

/// 1 for the envs whose last step is experience to learn from.
std::vector<std::uint8_t> RolloutCollector::experience(const Part& part) const {
  const auto active = part_of(env_.active(), part.first, part.count), quarantined = part_of(env_.quarantined(), part.first, part.count);
  std::vector<std::uint8_t> counts(active.begin(), active.end());
  for (std::size_t env = 0; env < counts.size(); ++env)
    if (quarantined[env] != 0 || part.actor.sanitized()[env] != 0) counts[env] = 0;
  return counts;
}

torch::Tensor RolloutCollector::hidden() const {
  std::vector<torch::Tensor> all;
  for (const Part& part : parts_) all.push_back(part.actor.hidden());
  return torch::cat(all);
}

torch::Tensor RolloutCollector::not_done() const {
  std::vector<torch::Tensor> all;
  for (const Part& part : parts_) all.push_back(part.actor.not_done());
  return torch::cat(all);
}

torch::Tensor RolloutCollector::oracle_acted() const {
  torch::Tensor flags = torch::empty({static_cast<std::int64_t>(oracle_acted_.size())});
  std::copy(oracle_acted_.begin(), oracle_acted_.end(), flags.data_ptr<float>());
  return flags;
}

void RolloutCollector::restore(const torch::Tensor& hidden, const torch::Tensor& not_done, const torch::Tensor& oracle_acted) {
  for (std::size_t env = 0; env < oracle_acted_.size(); ++env)
    oracle_acted_[env] = oracle_acted.defined() && oracle_acted[static_cast<std::int64_t>(env)].item<float>() != 0;
  for (Part& part : parts_) part.actor.restore(hidden.narrow(0, part.first, part.count), not_done.narrow(0, part.first, part.count));
}

std::uint64_t RolloutCollector::dropped_rows() const {
  std::uint64_t sum = 0;
  for (const Part& part : parts_) sum += part.rollout.dropped_rows();
  return sum;
}

std::uint64_t RolloutCollector::sanitized_rows() const {
  std::uint64_t sum = 0;
  for (const Part& part : parts_) sum += part.actor.sanitized_rows();
  return sum;
}

}  // namespace earshot
