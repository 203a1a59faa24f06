#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "envs/batch/batched_env_impl.h"

namespace earshot {

void BatchedEnv::Impl::refuse_while_under_way(const char* call) const {
  if (!sent_order.empty())
    throw std::logic_error(fmt::format("BatchedEnv::{}: {} environments are under way, call recv()", call, sent_order.size()));
}

void BatchedEnv::Impl::check_action(std::size_t row, std::int32_t action) const {
  if (rows.active()[row] == 0) return;
  const std::size_t env = env_of(row);
  if (envs[env].has_ended) {
    if (config.autoreset == Autoreset::off)
      throw std::logic_error(fmt::format("BatchedEnv: the episode of environment {} has ended, and autoreset is off: reset it", env));
    return;  // the action is not used
  }
  if (action < 0 || action >= kNumActions)
    throw std::invalid_argument(fmt::format("BatchedEnv: action {} of environment {} is not in [0, {})", action, env, kNumActions));
}

/// Here and not in the task: what an env that is given up did is written to a file while its stage still runs.
void BatchedEnv::Impl::take_actions(std::size_t env, std::span<const std::int32_t> actions) {
  for (std::size_t i = 0; i < per_env; ++i) {
    Agent& agent = agents[first_row(env) + i];
    agent.action = static_cast<Action>(actions[i]);
    if (!envs[env].has_ended && !agent.waits) agent.actions.push_back(static_cast<std::int8_t>(actions[i]));
  }
}

void BatchedEnv::step(std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  if (!in.started) throw std::logic_error("BatchedEnv::step: no episode has begun, call reset() first");
  in.refuse_while_under_way("step");
  if (actions.size() != in.agents.size())
    throw std::invalid_argument(fmt::format("BatchedEnv::step: {} actions for {} environments{}", actions.size(), in.envs.size(),
                                            in.per_env > 1 ? fmt::format(" of {} agents", in.per_env) : ""));
  for (std::size_t row = 0; row < actions.size(); ++row) in.check_action(row, actions[row]);
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    in.envs[env].job = Job::step;
    if (!in.wants_task(env)) {
      in.clear_outcome(env);
      continue;
    }
    if (in.envs[env].job == Job::step) in.take_actions(env, actions.subspan(in.first_row(env), in.per_env));
    in.submitted.push_back(env);
  }
  in.run_all();
  in.gather_failed_starts(in.all_envs);
}

void BatchedEnv::reset() {
  Impl& in = *impl_;
  in.refuse_while_under_way("reset");
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    if (in.envs[env].stalled && !in.wants_task(env)) continue;
    in.envs[env].job = Job::first;
    in.seed_env(env, in.config.seed, in.global_id(env));
    in.submitted.push_back(env);
  }
  in.started = true;
  in.run_all();
}

void BatchedEnv::reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds) {
  Impl& in = *impl_;
  in.refuse_while_under_way("reset");
  if (mask.size() != in.envs.size() || (!seeds.empty() && seeds.size() != in.envs.size()))
    throw std::invalid_argument(
        fmt::format("BatchedEnv::reset: {} flags and {} seeds for {} environments", mask.size(), seeds.size(), in.envs.size()));
  if (!in.started && std::ranges::count(mask, std::uint8_t{0}) > 0)
    throw std::logic_error("BatchedEnv::reset: no episode has begun, reset all environments first");
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    EnvRun& run = in.envs[env];
    if (mask[env] == 0 || (run.stalled && !in.wants_task(env))) continue;
    run.job = in.started && seeds.empty() ? Job::next : Job::first;
    run.comes_back = false;
    if (!seeds.empty())
      in.seed_env(env, seeds[env], 0);
    else if (!in.started)
      in.seed_env(env, in.config.seed, in.global_id(env));
    in.submitted.push_back(env);
  }
  in.started = true;
  in.run_all();
}

void BatchedEnv::send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  if (!in.started) throw std::logic_error("BatchedEnv::send: no episode has begun, call reset() first");
  if (envs.size() * in.per_env != actions.size())
    throw std::invalid_argument(
        fmt::format("BatchedEnv::send: {} environments of {} agents and {} actions", envs.size(), in.per_env, actions.size()));
  in.workers->run_in_background();
  const std::size_t sent_before = in.sent_order.size();
  try {
    for (std::size_t i = 0; i < envs.size(); ++i) {
      const std::size_t env = in.index_of(envs[i]);
      if (in.under_way[env] != 0) throw std::logic_error(fmt::format("BatchedEnv::send: environment {} is under way already", env));
      for (std::size_t agent = 0; agent < in.per_env; ++agent) in.check_action(in.first_row(env) + agent, actions[i * in.per_env + agent]);
      in.under_way[env] = 1;
      in.sent_order.push_back(static_cast<std::uint32_t>(env));
    }
  } catch (...) {  // nothing has moved
    for (std::size_t i = sent_before; i < in.sent_order.size(); ++i) in.under_way[in.sent_order[i]] = 0;
    in.sent_order.resize(sent_before);
    throw;
  }
  in.submitted.clear();
  for (std::size_t i = 0; i < envs.size(); ++i) {
    const std::size_t env = size_of(envs[i]);
    in.envs[env].job = Job::step;
    in.is_done[env] = 0;
    if (in.wants_task(env)) {
      if (in.envs[env].job == Job::step) in.take_actions(env, actions.subspan(i * in.per_env, in.per_env));
      in.submitted.push_back(static_cast<std::uint32_t>(env));
    } else {  // idle: there is nothing to wait for
      in.clear_outcome(env);
      in.is_done[env] = 1;
    }
  }
  in.workers->submit(in.submitted);
}

std::span<const std::int32_t> BatchedEnv::recv(int min_ready, RecvOrder order) {
  Impl& in = *impl_;
  if (min_ready < 1 || size_of(min_ready) > in.sent_order.size())
    throw std::invalid_argument(fmt::format("BatchedEnv::recv: {} of {} environments under way", min_ready, in.sent_order.size()));
  in.clear_finished();
  while (const auto completed = in.workers->done_already()) in.settle(*completed);
  const auto wanted = [&] {
    const auto last = order == RecvOrder::as_sent ? in.sent_order.begin() + min_ready : in.sent_order.end();
    return std::count_if(in.sent_order.begin(), last, [&](std::uint32_t env) { return in.is_done[env] != 0; });
  };
  while (wanted() < min_ready) in.settle(in.workers->next());

  in.submitted.clear();
  for (std::size_t i = 0; i < in.sent_order.size() && (order == RecvOrder::as_ready || i < size_of(min_ready)); ++i)
    if (in.is_done[in.sent_order[i]] != 0) in.submitted.push_back(in.sent_order[i]);
  in.draw_pending(in.submitted);
  for (const std::uint32_t env : in.submitted) in.under_way[env] = 0;
  std::erase_if(in.sent_order, [&](std::uint32_t env) { return in.under_way[env] == 0; });
  std::ranges::sort(in.submitted);
  in.received.assign(in.submitted.begin(), in.submitted.end());
  in.gather(in.submitted);
  in.gather_failed_starts(in.submitted);
  return in.received;
}

}  // namespace earshot
