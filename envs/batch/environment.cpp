// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/environment.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "envs/batch/episode_replay.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// One step in so many of an env is timed, stage by stage; its seconds count for all of them.
constexpr std::uint32_t kStepsPerTimed = 16;
/// How many other episodes an env tries when one cannot begin.
constexpr std::uint32_t kMaxDraws = 64;
/// After this many episodes of one env in a row that began and went wrong the run ends.
constexpr int kMaxFaultyInARow = 64;

}  // namespace

Environment::Environment(const EnvParts& parts, std::span<Agent> agents, std::size_t index, std::size_t helpers)
    : parts_(parts), tasks_(index), num_helpers_(helpers), first_helper_(index * helpers) {
  run_.agents = agents;
  if (helpers > 0) run_.team = std::make_unique<AgentTeam>(helpers);
  results_.ended.reserve(agents.size());
}

void Environment::assign(const EnvCursor& cursor) {
  job_ = Job::restore;
  cursor_ = cursor;
}

void Environment::seed(std::uint64_t seed, std::uint32_t stream) {
  own_.reset();
  for (Agent& agent : run_.agents) {
    agent.seed = seed;
    agent.stream = stream;
  }
}

void Environment::borrow(std::uint64_t its_seed, std::uint32_t its_stream) {
  const Agent& lead = run_.agents.front();
  const Sequence own = own_.value_or(Sequence{lead.seed, lead.stream, lead.episode_count});
  seed(its_seed, its_stream);
  own_ = own;
}

void Environment::name_episode(std::uint64_t episode_index, int episode_count) {
  for (Agent& agent : run_.agents) {
    agent.episode_index = episode_index;
    agent.episode_count = episode_count;
  }
}

void Environment::name_place(const Pose& pose, int steps) {
  job_ = Job::place;
  place_ = pose;
  place_steps_ = steps;
}

void Environment::take_actions(std::span<const std::int32_t> actions) {
  if (job_ != Job::step) return;
  for (std::size_t i = 0; i < actions.size(); ++i) {
    Agent& agent = run_.agents[i];
    agent.action = static_cast<Action>(actions[i]);
    if (!run_.has_ended() && !agent.waits) agent.actions.push_back(static_cast<std::int8_t>(actions[i]));
  }
}

void Environment::rejoin() {
  job_ = Job::rejoin;
  if (!run_.has_episode()) run_.phase = EpisodePhase::running;
  for (Agent& agent : run_.agents) {
    agent.pictures_now = agent.pictures_last = {};
    agent.fault.reset();
  }
}

void Environment::go_idle() {
  run_.phase = EpisodePhase::idle;
  EpisodeEntry::leave(run_);
  for (Agent& agent : run_.agents) {
    agent.pictures_now = {};
    agent.fault.reset();
  }
  clear_rows();
}

void Environment::publish() {
  for (const Agent& agent : run_.agents) parts_.rows.publish(agent.row, agent.outcome, run_.has_episode() && !agent.waits);
}

void Environment::clear_rows() {
  for (Agent& agent : run_.agents) parts_.senses.clear(agent);
}

bool Environment::goes_on() {
  if (workers_->beat(worker_)) return true;
  clear_rows();  // abandoned meanwhile: the rows of an env outside the batch are not an observation
  return false;
}

template <class Body>
bool Environment::for_agents(HearingEngines* engines, const Body& body) {
  if (AgentTeam* team = run_.team.get()) {
    for (std::size_t helper = 0; engines && helper < num_helpers_; ++helper)
      parts_.engines.of_helper(first_helper_ + helper);  // made here, where it may throw
    team->run(run_.agents.size(), [&](std::size_t agent, std::size_t member) {
      body(run_.agents[agent], member == 0 ? engines : parts_.engines.of_helper(first_helper_ + member - 1));
    });
    return true;
  }
  for (Agent& agent : run_.agents)
    if (!body(agent, engines)) return false;
  return true;
}

void Environment::run_task(EnvWorkers& workers, std::size_t worker) {
  const FlushDenormals flush;
  workers_ = &workers;
  worker_ = worker;
  results_.error = nullptr;
  try {
    HearingEngines* engines = parts_.engines.of_worker(worker);
    if (job_ == Job::step)
      step(engines);
    else
      begin_task(engines);
  } catch (...) {
    results_.error = std::current_exception();
  }
  if (goes_on()) publish();
}

void Environment::step(HearingEngines* engines) {
  const double weight = tasks_++ % kStepsPerTimed == 0 ? kStepsPerTimed : 0;
  for (Agent& agent : run_.agents) agent.outcome = {};
  if (!run_.has_ended() && (!step_episode(engines, weight) || parts_.setup.config.autoreset != Autoreset::same_step)) return;
  StageClock clock(run_.agents.front().seconds, 1);
  run_.phase = EpisodePhase::running;
  begin_next_episode(engines);
  clock.book(Stage::reset);
}

bool Environment::step_episode(HearingEngines* engines, double weight) {
  StageClock clock(run_.agents.front().seconds, weight);
  ++run_.steps;
  for (Agent& agent : run_.agents) {  // one after the other: none goes where another stands
    if (!goes_on()) return false;
    agent.outcome.acted = agent.runs();
    if (agent.runs()) parts_.faults.guard(agent, Fault::stage, [&] { parts_.senses.move(run_, agent, agent.action); });
  }
  clock.book(Stage::move);
  parts_.faults.guard(run_.agents.front(), Fault::stage,
                      [&] { run_.sounds.move(parts_.setup, run_.steps, run_.agents, engines, run_.team.get()); });
  if (run_.team) clock.book(Stage::trace);  // of one thread the first agent's trace says it
  const bool is_complete = for_agents(engines, [&](Agent& agent, HearingEngines* agent_engines) {
    const auto ask = [this] { return goes_on(); };
    if (!run_.team) return parts_.senses.sense(run_, agent, agent_engines, clock, ask);
    StageClock agent_clock(agent.seconds, weight);
    return parts_.senses.sense(run_, agent, agent_engines, agent_clock, ask);
  });
  if (!is_complete || !goes_on()) return false;
  if (run_.fault())
    end_faulty_episode();
  else if (!end_parts())
    return false;
  end_episode();
  return true;
}

bool Environment::end_parts() {
  if (std::ranges::all_of(run_.agents, [](const Agent& agent) { return agent.waits || agent.has_ended(); })) return true;
  for (Agent& agent : run_.agents)
    if (!agent.waits && agent.has_ended()) parts_.senses.end_part(agent);
  return false;
}

/// Of every job but a step.
void Environment::begin_task(HearingEngines* engines) {
  const Agent& lead = run_.agents.front();
  StageClock clock(run_.agents.front().seconds, 1);
  for (Agent& agent : run_.agents) agent.outcome = {};
  if (job_ == Job::place) return place(engines);
  if (run_.has_ended()) run_.phase = EpisodePhase::running;
  if (job_ == Job::first) {
    for (Agent& agent : run_.agents) agent.episode_count = -1;
    results_.failed_starts.clear();
  }
  if (job_ == Job::begin)
    begin_episode(lead.episode_index, lead.episode_count, engines);
  else if (job_ == Job::restore)
    restore(engines);
  else
    begin_next_episode(engines);
  // A returning env has not used its action: its rows must not be trained on, and belong to no earlier episode.
  if (job_ == Job::rejoin && run_.has_episode())
    for (Agent& agent : run_.agents) agent.outcome.truncated = agent.outcome.quarantined = true;
  clock.book(Stage::reset);
}

void Environment::begin_next_episode(HearingEngines* engines) {
  if (const std::optional<Sequence> own = own_) {
    seed(own->seed, own->stream);
    for (Agent& agent : run_.agents) agent.episode_count = own->episode_count;
  }
  const Agent& lead = run_.agents.front();
  const bool once = parts_.setup.config.order == EpisodeOrder::once;
  int count = lead.episode_count + 1;
  // Order `once` needs no bound: its episodes come to an end.
  for (std::uint32_t attempt = 0; once || attempt < kMaxDraws; ++attempt) {
    const auto index = parts_.entry.choose(lead, count, once ? 0 : attempt);
    if (!index) return go_idle();
    begin_episode(*index, count, engines);
    if (!goes_on()) return;
    const FaultReport* fault = run_.fault();
    if (!fault) {
      if (const auto next = parts_.entry.choose(lead, count + 1, 0)) parts_.entry.prefetch(*next);
      return;
    }
    parts_.faults.quarantine(run_.agents, *fault);
    parts_.faults.count_failed_start();
    if (once) {
      for (const Agent& agent : run_.agents) results_.failed_starts.push_back(parts_.faults.failed_episode(agent, *fault, true));
      ++count;
    }
  }
  const Episode& last = parts_.setup.set->episodes[lead.episode_index];
  const FaultReport fault = *run_.fault();
  go_idle();
  parts_.faults.stop_if_out_of_memory();
  throw InputError("episode set",
                   fmt::format("{} episodes in a row could not start, the last one because of its {}: episode '{}' in {}: {}", kMaxDraws,
                               name_of(fault.fault), last.episode_id, last.scene_id, fault.detail),
                   "restore the missing files, or write the episode set again for these scenes and this agent size");
}

void Environment::begin_episode(std::uint64_t episode_index, int episode_count, HearingEngines* engines) {
  parts_.entry.prepare(run_, episode_index, episode_count);
  // The actions and the episode of an abandoned env are read while its stage still runs: it is known from here on.
  if (!goes_on()) return;
  parts_.faults.guard(run_.agents.front(), Fault::scene, [&] {
    parts_.entry.enter(run_);
    if (run_.fault() || !goes_on()) return;
    run_.sounds.move(parts_.setup, run_.steps, run_.agents, engines, run_.team.get());
    for_agents(engines, [&](Agent& agent, HearingEngines* agent_engines) {
      parts_.faults.guard(agent, Fault::scene, [&] { parts_.senses.observe_start(run_, agent, agent_engines); });
      return true;
    });
  });
  if (!run_.fault()) parts_.faults.count_begun();
}

void Environment::restore(HearingEngines* engines) {
  seed(cursor_.seed, cursor_.stream);
  for (Agent& agent : run_.agents) agent.episode_count = cursor_.episode_count;
  results_.failed_starts.clear();
  if (!cursor_.active) return go_idle();
  if (cursor_.is_void && parts_.setup.config.autoreset == Autoreset::same_step) return begin_next_episode(engines);
  parts_.entry.prepare(run_, cursor_.episode_index, cursor_.episode_count);
  if (cursor_.is_void) {
    clear_rows();
    run_.phase = EpisodePhase::voided;
    return;
  }
  const auto stop_at_fault = [&] {
    const FaultReport* fault = run_.fault();
    if (!fault) return;
    const Episode& episode = parts_.setup.set->episodes[cursor_.episode_index];
    throw InputError("episode '" + episode.episode_id + "' in " + episode.scene_id, fault->detail,
                     "restore the missing files, or use another checkpoint; the episode was valid when the state was saved");
  };
  parts_.entry.enter(run_);
  stop_at_fault();
  parts_.faults.count_begun();
  EpisodeReplay(parts_.setup, parts_.senses, run_, cursor_, engines).walk();
  stop_at_fault();
  if (!cursor_.ended) return;
  run_.phase = EpisodePhase::ended;
  for (Agent& agent : run_.agents) {
    if (!agent.waits) parts_.senses.keep(agent);
    agent.waits = false;
  }
}

/// The window of sound is that of an agent who has stood there.
void Environment::place(HearingEngines* engines) {
  Agent& agent = run_.agents.front();
  agent.state.place(run_.goal_of(agent), place_.position, place_.heading_rad, place_steps_);
  run_.steps = place_steps_;
  run_.was_placed = true;
  agent.pictures_are_current = false;
  parts_.faults.guard(agent, Fault::stage, [&] {
    if (engines) {
      run_.sounds.clear();
      run_.sounds.begin(parts_.setup, run_.agents);
      agent.hearing.seek(size_of(place_steps_) * size_of(parts_.setup.block_samples));
      run_.sounds.move(parts_.setup, place_steps_, run_.agents, engines, run_.team.get());
    }
    parts_.senses.observe_start(run_, agent, engines);
  });
}

/// In the step that found the fault: no reward, truncated, all observations zero, of all agents of the env.
void Environment::end_faulty_episode() {
  const FaultReport& fault = *run_.fault();
  parts_.faults.quarantine(run_.agents, fault);
  for (Agent& agent : run_.agents) agent.outcome = {.truncated = true, .quarantined = true, .acted = agent.outcome.acted};
  clear_rows();
  for (Agent& agent : run_.agents) agent.waits = false;  // the last rows of all are zero
  // One bad scene among many does not reach this count; a broken set would continue without end and without a whole episode.
  if (++faulty_in_a_row_ >= kMaxFaultyInARow && parts_.setup.config.order == EpisodeOrder::random)
    throw InputError(fmt::format("env {}", run_.agents.front().env_id),
                     fmt::format("{} episodes in a row were quarantined, the last one because of its {}: {}", kMaxFaultyInARow,
                                 name_of(fault.fault), fault.detail),
                     "set quarantine_dir, and run 'earshot replay' on a file in it");
}

/// Books the last observations and what became of the episode.
void Environment::end_episode() {
  const FaultReport* fault = run_.fault();
  run_.phase = fault ? EpisodePhase::voided : EpisodePhase::ended;
  if (!fault) faulty_in_a_row_ = 0;
  for (Agent& agent : run_.agents) {
    if (!agent.waits) parts_.senses.keep(agent);
    agent.waits = false;  // for none any more
    if (fault) {
      if (parts_.setup.config.order == EpisodeOrder::once) results_.ended.push_back(parts_.faults.failed_episode(agent, *fault, true));
      continue;
    }
    std::vector<std::int8_t> actions = std::move(agent.spare_actions);
    actions.reserve(size_of(parts_.setup.config.task.max_steps));
    actions.assign(agent.actions.begin(), agent.actions.end());
    FinishedEpisode& ended = results_.ended.emplace_back();
    ended.env = agent.env_id;
    ended.episode_index = agent.episode_index;
    ended.metrics = agent.state.metrics(parts_.setup.config.task);
    ended.actions = std::move(actions);
    ended.agent = agent.number;
  }
}

void Environment::give_up() {
  const EnvConfig& config = parts_.setup.config;
  const FaultReport fault{Fault::stall, stall_text(config)};
  parts_.faults.quarantine(run_.agents, fault);
  for (const Agent& agent : run_.agents) {
    if (config.order == EpisodeOrder::once) results_.given_up.push_back(parts_.faults.failed_episode(agent, fault, false));
    parts_.rows.give_up(agent.row);
  }
}

EnvCursor Environment::cursor(bool given_up) const {
  const Agent& lead = run_.agents.front();
  const bool is_void = given_up || run_.phase == EpisodePhase::voided;
  EnvCursor cursor{.active = given_up || run_.has_episode(),
                   .ended = !given_up && run_.has_ended(),
                   .is_void = is_void,
                   .seed = lead.seed,
                   .stream = lead.stream,
                   .episode_index = lead.episode_index,
                   .episode_count = std::max(0, lead.episode_count),
                   .actions = is_void ? std::vector<std::int8_t>{} : lead.actions};
  if (lead.source && cursor.active && !is_void) cursor.scene = lead.source->scene->scene->hash();
  for (const Agent& agent : run_.agents.subspan(1)) cursor.others.push_back(is_void ? std::vector<std::int8_t>{} : agent.actions);
  return cursor;
}

}  // namespace earshot
