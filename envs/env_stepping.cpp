#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "envs/batched_env_impl.h"

namespace earshot {
namespace {

/// One step in so many of an env is timed, stage by stage; its seconds count for all of them.
constexpr std::uint32_t kStepsPerTimed = 16;

/// Books the time since the last call to a stage, if this step is one of those that are timed.
class StageClock {
 public:
  StageClock(std::array<double, num_stages>& seconds, double weight) : seconds_(&seconds), weight_(weight) {
    if (weight_ > 0) last_ = std::chrono::steady_clock::now();
  }
  void book(Stage stage) {
    if (weight_ <= 0) return;
    const auto now = std::chrono::steady_clock::now();
    (*seconds_)[stage] += weight_ * std::chrono::duration<double>(now - last_).count();
    last_ = now;
  }

 private:
  std::array<double, num_stages>* seconds_;
  double weight_;
  std::chrono::steady_clock::time_point last_;
};

}  // namespace

HearingEngines* BatchedEnv::Impl::engines_of(std::size_t worker) {
  if (!make_engines) return nullptr;
  if (!engines[worker]) engines[worker] = make_engines();
  return engines[worker].get();
}

bool BatchedEnv::Impl::goes_on(std::size_t env) {
  if (workers->beat(agents[env].worker)) return true;
  // Given up meanwhile: what the stage has left in the rows of an env that is out of the batch is no observation.
  active[env] = 0;
  rewards[env] = 0.f;
  terminated[env] = collided[env] = 0;
  clear_rows(env);
  return false;
}

void BatchedEnv::Impl::run_task(std::size_t env, std::size_t worker) {
  const FlushDenormals flush;
  Agent& agent = agents[env];
  agent.worker = worker;
  agent.error = nullptr;
  try {
    HearingEngines* own = engines_of(worker);
    if (agent.job == Job::step) return step_task(env, own);
    StageClock clock(agent.seconds, 1);
    clear_outcome(env);
    agent.has_ended = false;
    if (agent.job == Job::first) {
      agent.episode_count = -1;
      agent.failed_starts.clear();
    }
    if (agent.job == Job::begin)
      begin_episode(env, agent.episode_index, agent.episode_count, own);
    else if (agent.job == Job::restore)
      restore(env, agent.cursor, own);
    else
      begin_next_episode(env, own);
    // The action of an env that comes back has not been used: its row is no experience, and belongs to no episode before.
    const bool came_by_a_step = std::exchange(agent.comes_back, false) && agent.job == Job::next;
    if (came_by_a_step && active[env] != 0) truncated[env] = quarantined[env] = 1;
    clock.book(reset_stage);
  } catch (...) {
    agent.error = std::current_exception();
  }
}

void BatchedEnv::Impl::step_task(std::size_t env, HearingEngines* own) {
  Agent& agent = agents[env];
  const bool timed = (agent.tasks++ + env) % kStepsPerTimed == 0;
  StageClock clock(agent.seconds, timed ? kStepsPerTimed : 0);
  bool ours = true;
  const auto stage = [&](Stage which, const auto& body) {
    ours = ours && goes_on(env);
    if (!ours) return;
    if (runs(env)) guarded(env, Fault::stage, body);
    clock.book(which);
  };
  clear_outcome(env);
  if (!agent.has_ended) {
    stage(move_stage, [&] { move(env, agent.action); });
    stage(trace_stage, [&] { trace(env, own, block_samples); });
    stage(synthesize_stage, [&] { synthesize(env, own); });
    stage(convolve_stage, [&] { convolve(env, own); });
    stage(render_stage, [&] { render(env); });
    stage(observe_stage, [&] { observe(env, own); });
    if (!ours || !goes_on(env)) return;
    end_faulty_episode(env);
    if (!ended(env)) return;
    end_episode(env);
    if (config.autoreset != Autoreset::same_step) return;
  }
  StageClock reset_clock(agent.seconds, 1);
  agent.has_ended = false;
  begin_next_episode(env, own);
  reset_clock.book(reset_stage);
}

/// Books the last observation and what became of the episode.
void BatchedEnv::Impl::end_episode(std::size_t env) {
  Agent& agent = agents[env];
  agent.has_ended = true;
  keep_rows(env);
  if (!agent.fault) {
    agent.faulty_in_a_row = 0;
    std::vector<std::int8_t> actions = std::move(agent.spare_actions);
    actions.reserve(size_of(config.task.max_steps));
    actions.assign(agent.actions.begin(), agent.actions.end());
    agent.ended = {.env = static_cast<int>(global_id(env)),
                   .episode_index = agent.episode_index,
                   .metrics = agent.state.metrics(config.task),
                   .actions = std::move(actions)};
  } else if (config.order == EpisodeOrder::once) {
    agent.ended = failed_episode(env, *agent.fault);
  }
}

bool BatchedEnv::Impl::wants_task(std::size_t env) {
  Agent& agent = agents[env];
  if (agent.stalled) {
    if (!workers->has_returned(env)) return false;
    agent.stalled = false;  // its thread is done with it: it begins another episode
    agent.pictures_now = agent.pictures_last = {};
    agent.comes_back = true;
    active[env] = 1;
    agent.job = Job::next;
    agent.fault.reset();
  }
  return active[env] != 0;
}

void BatchedEnv::Impl::settle(CompletedEnv completed) {
  const std::size_t env = completed.env;
  if (completed.stalled) quarantine_stalled(env);
  is_done[env] = 1;
}

void BatchedEnv::Impl::gather(std::span<const std::uint32_t> envs) {
  std::exception_ptr error;  // of the first env that has one; all are gathered before it is thrown
  for (const std::uint32_t env : envs) {
    Agent& agent = agents[env];
    if (agent.stalled_one) {
      finished.push_back(std::move(*agent.stalled_one));
      agent.stalled_one.reset();
    }
    if (agent.stalled) continue;  // its thread still writes there
    for (std::size_t stage = 0; stage < num_stages; ++stage) {
      stage_seconds.*kStageSeconds[stage] += agent.seconds[stage];
      agent.seconds[stage] = 0;
    }
    if (agent.ended) {
      finished.push_back(std::move(*agent.ended));
      agent.ended.reset();
      if (!spare_actions.empty()) {
        agent.spare_actions = std::move(spare_actions.back());
        spare_actions.pop_back();
      }
    }
    if (agent.error && !error) error = agent.error;
    agent.error = nullptr;
  }
  if (error) std::rethrow_exception(error);
  stop_if_none_begins();
}

/// The storage of their actions goes to episodes that end later.
void BatchedEnv::Impl::clear_finished() {
  for (FinishedEpisode& episode : finished)
    if (spare_actions.size() < spare_actions.capacity()) spare_actions.push_back(std::move(episode.actions));
  finished.clear();
}

void BatchedEnv::Impl::require_settled(std::size_t env, const char* call) {
  if (!agents[env].stalled || wants_task(env)) return;
  throw std::logic_error(fmt::format("BatchedEnv::{}: a stage of environment {} still runs, long after its limit", call, env));
}

/// Episodes that could not begin are among the finished of the step or recv() that follows: callers of reset() look at no finished ones.
void BatchedEnv::Impl::gather_failed_starts(std::span<const std::uint32_t> envs) {
  for (const std::uint32_t env : envs) {
    if (agents[env].stalled) continue;
    std::ranges::move(agents[env].failed_starts, std::back_inserter(finished));
    agents[env].failed_starts.clear();
  }
}

void BatchedEnv::Impl::run_all() {
  clear_finished();
  workers->submit(submitted);
  workers->finish([&](CompletedEnv completed) { settle(completed); });
  draw_pending(submitted);
  gather(submitted);
}

void BatchedEnv::Impl::refuse_while_under_way(const char* call) const {
  if (!sent_order.empty())
    throw std::logic_error(fmt::format("BatchedEnv::{}: {} environments are under way, call recv()", call, sent_order.size()));
}

void BatchedEnv::Impl::check_action(std::size_t env, std::int32_t action) const {
  if (active[env] == 0) return;
  if (agents[env].has_ended) {
    if (config.autoreset == Autoreset::off)
      throw std::logic_error(fmt::format("BatchedEnv: the episode of environment {} has ended, and autoreset is off: reset it", env));
    return;  // the action is not used
  }
  if (action < 0 || action >= kNumActions)
    throw std::invalid_argument(fmt::format("BatchedEnv: action {} of environment {} is not in [0, {})", action, env, kNumActions));
}

void BatchedEnv::step(std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  if (!in.started) throw std::logic_error("BatchedEnv::step: no episode has begun, call reset() first");
  in.refuse_while_under_way("step");
  if (actions.size() != in.agents.size())
    throw std::invalid_argument(fmt::format("BatchedEnv::step: {} actions for {} environments", actions.size(), in.agents.size()));
  for (std::size_t env = 0; env < actions.size(); ++env) in.check_action(env, actions[env]);
  in.submitted.clear();
  for (std::size_t env = 0; env < actions.size(); ++env) {
    in.agents[env].job = Job::step;
    in.agents[env].action = static_cast<Action>(actions[env]);
    if (in.wants_task(env))
      in.submitted.push_back(static_cast<std::uint32_t>(env));
    else
      in.clear_outcome(env);
  }
  in.run_all();
  in.gather_failed_starts(in.all_envs);
}

void BatchedEnv::reset() {
  Impl& in = *impl_;
  in.refuse_while_under_way("reset");
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    Agent& agent = in.agents[env];
    if (agent.stalled && !in.wants_task(env)) continue;
    agent.job = Job::first;
    agent.seed = in.config.seed;
    agent.stream = in.global_id(env);
    in.submitted.push_back(env);
  }
  in.started = true;
  in.run_all();
}

void BatchedEnv::reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds) {
  Impl& in = *impl_;
  in.refuse_while_under_way("reset");
  if (mask.size() != in.agents.size() || (!seeds.empty() && seeds.size() != in.agents.size()))
    throw std::invalid_argument(
        fmt::format("BatchedEnv::reset: {} flags and {} seeds for {} environments", mask.size(), seeds.size(), in.agents.size()));
  if (!in.started && std::ranges::count(mask, std::uint8_t{0}) > 0)
    throw std::logic_error("BatchedEnv::reset: no episode has begun, reset all environments first");
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    Agent& agent = in.agents[env];
    if (mask[env] == 0 || (agent.stalled && !in.wants_task(env))) continue;
    agent.job = in.started && seeds.empty() ? Job::next : Job::first;
    agent.comes_back = false;
    if (!seeds.empty()) {
      agent.seed = seeds[env];
      agent.stream = 0;
    } else if (!in.started) {
      agent.seed = in.config.seed;
      agent.stream = in.global_id(env);
    }
    in.submitted.push_back(env);
  }
  in.started = true;
  in.run_all();
}

void BatchedEnv::send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  if (!in.started) throw std::logic_error("BatchedEnv::send: no episode has begun, call reset() first");
  if (envs.size() != actions.size())
    throw std::invalid_argument(fmt::format("BatchedEnv::send: {} environments and {} actions", envs.size(), actions.size()));
  in.workers->run_in_background();
  const std::size_t sent_before = in.sent_order.size();
  try {
    for (std::size_t i = 0; i < envs.size(); ++i) {
      const std::size_t env = in.index_of(envs[i]);
      if (in.under_way[env] != 0) throw std::logic_error(fmt::format("BatchedEnv::send: environment {} is under way already", env));
      in.check_action(env, actions[i]);
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
    in.agents[env].job = Job::step;
    in.agents[env].action = static_cast<Action>(actions[i]);
    in.is_done[env] = 0;
    if (in.wants_task(env)) {
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
