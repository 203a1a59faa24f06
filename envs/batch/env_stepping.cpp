#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "envs/batch/batched_env_impl.h"

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
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row)
    rows.publish(row, agents[row].outcome, envs[env].has_episode && !agents[row].waits);
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
  run.is_void = fault != nullptr;
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
    FinishedEpisode& ended = run.ended.emplace_back();
    ended.env = static_cast<int>(global_id(env));
    ended.episode_index = agent.episode_index;
    ended.metrics = agent.state.metrics(config.task);
    ended.actions = std::move(actions);
    ended.agent = agent_of(row);
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

}  // namespace earshot
