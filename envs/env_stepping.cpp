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

}  // namespace

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

HearingEngines* BatchedEnv::Impl::engines_of(std::size_t worker) {
  if (!make_engines) return nullptr;
  if (!engines[worker]) engines[worker] = make_engines();
  return engines[worker].get();
}

bool BatchedEnv::Impl::goes_on(std::size_t env) {
  if (workers->beat(envs[env].worker)) return true;
  clear_rows(env);  // given up meanwhile: what the stage has left in the rows of an env that is out of the batch is no observation
  return false;
}

void BatchedEnv::Impl::publish(std::size_t env) {
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) {
    const StepOutcome& outcome = agents[row].outcome;
    rewards[row] = outcome.reward;
    terminated[row] = outcome.terminated;
    truncated[row] = outcome.truncated;
    collided[row] = outcome.collided;
    quarantined[row] = outcome.quarantined;
    acted[row] = outcome.acted;
    active[row] = envs[env].has_episode && !agents[row].waits;
  }
}

void BatchedEnv::Impl::run_task(std::size_t env, std::size_t worker) {
  const FlushDenormals flush;
  EnvRun& run = envs[env];
  run.worker = worker;
  run.error = nullptr;
  try {
    HearingEngines* own = engines_of(worker);
    if (run.job == Job::step)
      step_task(env, own);
    else
      begin_task(env, own);
  } catch (...) {
    run.error = std::current_exception();
  }
  if (goes_on(env)) publish(env);
}

/// Of every job but a step.
void BatchedEnv::Impl::begin_task(std::size_t env, HearingEngines* own) {
  EnvRun& run = envs[env];
  Agent& lead = agents[first_row(env)];
  StageClock clock(lead.seconds, 1);
  for (Agent& agent : agents_of(env)) agent.outcome = {};
  run.has_ended = false;
  if (run.job == Job::first) {
    for (Agent& agent : agents_of(env)) agent.episode_count = -1;
    run.failed_starts.clear();
  }
  if (run.job == Job::begin)
    begin_episode(env, lead.episode_index, lead.episode_count, own);
  else if (run.job == Job::restore)
    restore(env, run.cursor, own);
  else
    begin_next_episode(env, own);
  // The action of an env that comes back has not been used: its rows are no experience, and belong to no episode before.
  const bool came_by_a_step = std::exchange(run.comes_back, false) && run.job == Job::next;
  if (came_by_a_step && run.has_episode)
    for (Agent& agent : agents_of(env)) agent.outcome.truncated = agent.outcome.quarantined = true;
  clock.book(reset_stage);
}

void BatchedEnv::Impl::step_task(std::size_t env, HearingEngines* own) {
  EnvRun& run = envs[env];
  const std::size_t first = first_row(env), end = first + per_env;
  const double weight = (run.tasks++ + env) % kStepsPerTimed == 0 ? kStepsPerTimed : 0;
  for (Agent& agent : agents_of(env)) agent.outcome = {};
  if (!run.has_ended) {
    StageClock clock(agents[first].seconds, weight);
    ++run.steps;
    for (std::size_t row = first; row < end; ++row) {  // one after the other: none goes where another stands
      if (!goes_on(env)) return;
      agents[row].outcome.acted = runs(row);
      if (runs(row)) guarded(row, Fault::stage, [&] { move(row, agents[row].action); });
    }
    clock.book(move_stage);
    guarded(first, Fault::stage, [&] { move_sounds(env, own); });
    if (run.team) clock.book(trace_stage);  // of one thread the first agent's trace says it
    const bool ours = for_agents(env, own, [&](std::size_t row, HearingEngines* engine) {
      if (!run.team) return sense(row, engine, clock);
      StageClock own_clock(agents[row].seconds, weight);
      return sense(row, engine, own_clock);
    });
    if (!ours) return;
    if (!goes_on(env)) return;
    if (fault_of(env)) {
      end_faulty_episode(env);
    } else {
      bool all_ended = true;
      for (std::size_t row = first; row < end; ++row) all_ended = all_ended && (agents[row].waits || ended(row));
      for (std::size_t row = first; row < end && !all_ended; ++row)
        if (!agents[row].waits && ended(row)) end_part(row);
      if (!all_ended) return;
    }
    end_episode(env);
    if (config.autoreset != Autoreset::same_step) return;
  }
  StageClock reset_clock(agents[first].seconds, 1);
  run.has_ended = false;
  begin_next_episode(env, own);
  reset_clock.book(reset_stage);
}

bool BatchedEnv::Impl::sense(std::size_t row, HearingEngines* own, StageClock& clock) {
  bool ours = true;
  const auto stage = [&](Stage which, const auto& body) {
    ours = ours && goes_on(env_of(row));
    if (!ours) return;
    if (runs(row)) guarded(row, Fault::stage, body);
    clock.book(which);
  };
  stage(trace_stage, [&] { trace(row, own, block_samples); });
  stage(synthesize_stage, [&] { synthesize(row, own); });
  stage(convolve_stage, [&] { convolve(row, own); });
  stage(render_stage, [&] { render(row); });
  stage(observe_stage, [&] { observe(row, own); });
  return ours;
}

void BatchedEnv::Impl::end_part(std::size_t row) {
  keep_rows(row);
  clear_row(row);
  agents[row].waits = true;
}

/// Books the last observations and what became of the episode.
void BatchedEnv::Impl::end_episode(std::size_t env) {
  EnvRun& run = envs[env];
  run.has_ended = true;
  const FaultReport* fault = fault_of(env);
  if (!fault) run.faulty_in_a_row = 0;
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) {
    Agent& agent = agents[row];
    if (!agent.waits) keep_rows(row);
    agent.waits = false;  // for none any more
    if (fault) {
      if (config.order == EpisodeOrder::once) run.ended.push_back(failed_episode(row, *fault));
      continue;
    }
    std::vector<std::int8_t> actions = std::move(agent.spare_actions);
    actions.reserve(size_of(config.task.max_steps));
    actions.assign(agent.actions.begin(), agent.actions.end());
    run.ended.push_back({.env = static_cast<int>(global_id(env)),
                         .episode_index = agent.episode_index,
                         .metrics = agent.state.metrics(config.task),
                         .actions = std::move(actions),
                         .agent = agent_of(row)});
  }
}

bool BatchedEnv::Impl::wants_task(std::size_t env) {
  EnvRun& run = envs[env];
  if (run.stalled) {
    if (!workers->has_returned(env)) return false;
    run.stalled = false;  // its thread is done with it: it begins another episode
    run.comes_back = true;
    run.has_episode = true;
    run.job = Job::next;
    for (Agent& agent : agents_of(env)) {
      agent.pictures_now = agent.pictures_last = {};
      agent.fault.reset();
    }
  }
  return run.has_episode;
}

void BatchedEnv::Impl::settle(CompletedEnv completed) {
  const std::size_t env = completed.env;
  if (completed.stalled) quarantine_stalled(env);
  is_done[env] = 1;
}

void BatchedEnv::Impl::gather(std::span<const std::uint32_t> done) {
  std::exception_ptr error;  // of the first env that has one; all are gathered before it is thrown
  for (const std::uint32_t env : done) {
    EnvRun& run = envs[env];
    const auto finish = [&](std::vector<FinishedEpisode>& episodes) {
      std::ranges::move(episodes, std::back_inserter(finished));
      episodes.clear();
    };
    finish(run.stalled_ones);
    if (run.stalled) continue;  // its thread still writes there
    for (Agent& agent : agents_of(env))
      for (std::size_t stage = 0; stage < num_stages; ++stage) {
        stage_seconds.*kStageSeconds[stage] += agent.seconds[stage];
        agent.seconds[stage] = 0;
      }
    for (std::size_t i = 0; i < run.ended.size() && !spare_actions.empty(); ++i) {
      agents_of(env)[i].spare_actions = std::move(spare_actions.back());
      spare_actions.pop_back();
    }
    finish(run.ended);
    if (run.error && !error) error = run.error;
    run.error = nullptr;
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
  if (!envs[env].stalled || wants_task(env)) return;
  throw std::logic_error(fmt::format("BatchedEnv::{}: a stage of environment {} still runs, long after its limit", call, env));
}

/// Episodes that could not begin are among the finished of the step or recv() that follows: callers of reset() look at no finished ones.
void BatchedEnv::Impl::gather_failed_starts(std::span<const std::uint32_t> done) {
  for (const std::uint32_t env : done) {
    if (envs[env].stalled) continue;
    std::ranges::move(envs[env].failed_starts, std::back_inserter(finished));
    envs[env].failed_starts.clear();
  }
}

void BatchedEnv::Impl::run_all() {
  clear_finished();
  workers->submit(submitted);
  workers->finish([&](CompletedEnv completed) { settle(completed); });
  draw_pending(submitted);
  gather(submitted);
}

void BatchedEnv::Impl::seed_env(std::size_t env, std::uint64_t seed, std::uint32_t stream) {
  for (Agent& agent : agents_of(env)) {
    agent.seed = seed;
    agent.stream = stream;
  }
}

void BatchedEnv::Impl::refuse_while_under_way(const char* call) const {
  if (!sent_order.empty())
    throw std::logic_error(fmt::format("BatchedEnv::{}: {} environments are under way, call recv()", call, sent_order.size()));
}

void BatchedEnv::Impl::check_action(std::size_t row, std::int32_t action) const {
  if (active[row] == 0) return;
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
