// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/env_scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace earshot {

EnvScheduler::EnvScheduler(const EnvParts& parts, PictureQueue& pictures, std::span<Environment> envs, int threads)
    : parts_(parts),
      pictures_(&pictures),
      envs_(envs),
      all_envs_(envs.size()),
      send_state_(envs.size()),
      stalled_(envs.size()),
      effects_(parts.rows.num_rows()),
      cached_responses_(parts.rows.num_rows()) {
  std::iota(all_envs_.begin(), all_envs_.end(), std::uint32_t{0});
  for (const std::uint32_t env : all_envs_) envs_[env].seed(parts_.setup.config.seed, parts_.setup.global_id(env));
  submitted_.reserve(envs.size());
  sent_order_.reserve(envs.size());
  received_.reserve(envs.size());
  finished_.reserve(parts.rows.num_rows());
  spare_actions_.reserve(parts.rows.num_rows());
  workers_.emplace(threads, envs.size(), parts.setup.config.stage_limit_s,
                   [this](std::size_t env, std::size_t worker) { envs_[env].run_task(*workers_, worker); });
}

std::size_t EnvScheduler::index_of(int env) const {
  if (env < 0 || size_of(env) >= envs_.size())
    throw std::out_of_range(fmt::format("BatchedEnv: environment {} is out of range: the batch has {} environments", env, envs_.size()));
  return size_of(env);
}

void EnvScheduler::refuse_while_under_way(const char* call) const {
  if (!sent_order_.empty())
    throw std::logic_error(fmt::format("BatchedEnv::{}: {} environments are still stepping; call recv() first", call, sent_order_.size()));
}

void EnvScheduler::check_action(std::size_t row, std::int32_t action) const {
  if (parts_.rows.active()[row] == 0) return;
  const std::size_t env = row / parts_.setup.per_env;
  if (envs_[env].run().has_ended()) {
    if (parts_.setup.config.autoreset == Autoreset::off)
      throw std::logic_error(fmt::format("BatchedEnv: the episode of environment {} has ended and autoreset is off; reset it first", env));
    return;  // the action is not used
  }
  if (action < 0 || action >= kNumActions)
    throw std::invalid_argument(fmt::format("BatchedEnv: action {} of environment {} is outside [0, {})", action, env, kNumActions));
}

bool EnvScheduler::takes_part(std::size_t env) {
  if (stalled_[env] != 0) {
    if (!workers_->has_returned(env)) return false;
    stalled_[env] = 0;
    envs_[env].rejoin();
  }
  return envs_[env].run().has_episode();
}

void EnvScheduler::require_settled(std::size_t env, const char* call) {
  if (stalled_[env] == 0 || takes_part(env)) return;
  throw std::logic_error(fmt::format("BatchedEnv::{}: a stage of environment {} is still running long after stage_limit_s", call, env));
}

bool EnvScheduler::submit_step(std::size_t env, std::span<const std::int32_t> actions) {
  if (stalled_[env] == 0) envs_[env].assign(Job::step);  // else rejoin() names the job, once its task has returned
  if (!takes_part(env)) {
    for (const Agent& agent : envs_[env].agents()) parts_.rows.clear_outcome(agent.row);
    return false;
  }
  envs_[env].take_actions(actions);
  submitted_.push_back(static_cast<std::uint32_t>(env));
  return true;
}

void EnvScheduler::step(std::span<const std::int32_t> actions) {
  if (!has_started_) throw std::logic_error("BatchedEnv::step: no episode has started; call reset() first");
  refuse_while_under_way("step");
  const std::size_t per_env = parts_.setup.per_env;
  if (actions.size() != parts_.rows.num_rows())
    throw std::invalid_argument(fmt::format("BatchedEnv::step: got {} actions for {} environments{}", actions.size(), envs_.size(),
                                            per_env > 1 ? fmt::format(" of {} agents", per_env) : ""));
  for (std::size_t row = 0; row < actions.size(); ++row) check_action(row, actions[row]);
  submitted_.clear();
  for (const std::uint32_t env : all_envs_) submit_step(env, actions.subspan(env * per_env, per_env));
  run_all();
  gather_failed_starts(all_envs_);
}

void EnvScheduler::reset() {
  refuse_while_under_way("reset");
  submitted_.clear();
  for (const std::uint32_t env : all_envs_) {
    if (stalled_[env] != 0 && !takes_part(env)) continue;
    envs_[env].assign(Job::first);
    envs_[env].seed(parts_.setup.config.seed, parts_.setup.global_id(env));
    submitted_.push_back(env);
  }
  has_started_ = true;
  run_all();
}

void EnvScheduler::reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds) {
  refuse_while_under_way("reset");
  if (mask.size() != envs_.size() || (!seeds.empty() && seeds.size() != envs_.size()))
    throw std::invalid_argument(
        fmt::format("BatchedEnv::reset: got {} flags and {} seeds for {} environments", mask.size(), seeds.size(), envs_.size()));
  if (!has_started_ && std::ranges::count(mask, std::uint8_t{0}) > 0)
    throw std::logic_error("BatchedEnv::reset: no episode has started; reset all environments first");
  submitted_.clear();
  for (const std::uint32_t env : all_envs_) {
    if (mask[env] == 0 || (stalled_[env] != 0 && !takes_part(env))) continue;
    envs_[env].assign(has_started_ && seeds.empty() ? Job::next : Job::first);
    if (!seeds.empty())
      envs_[env].seed(seeds[env], 0);
    else if (!has_started_)
      envs_[env].seed(parts_.setup.config.seed, parts_.setup.global_id(env));
    submitted_.push_back(env);
  }
  has_started_ = true;
  run_all();
}

void EnvScheduler::send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions) {
  const std::size_t per_env = parts_.setup.per_env;
  if (!has_started_) throw std::logic_error("BatchedEnv::send: no episode has started; call reset() first");
  if (envs.size() * per_env != actions.size())
    throw std::invalid_argument(
        fmt::format("BatchedEnv::send: got {} environments with {} agents each and {} actions", envs.size(), per_env, actions.size()));
  workers_->run_in_background();
  const std::size_t sent_before = sent_order_.size();
  try {
    for (std::size_t i = 0; i < envs.size(); ++i) {
      const std::size_t env = index_of(envs[i]);
      if (is_under_way(env)) throw std::logic_error(fmt::format("BatchedEnv::send: environment {} is already stepping", env));
      for (std::size_t agent = 0; agent < per_env; ++agent) check_action(env * per_env + agent, actions[i * per_env + agent]);
      send_state_[env] = SendState::under_way;
      sent_order_.push_back(static_cast<std::uint32_t>(env));
    }
  } catch (...) {  // nothing has moved
    for (std::size_t i = sent_before; i < sent_order_.size(); ++i) send_state_[sent_order_[i]] = SendState::at_rest;
    sent_order_.resize(sent_before);
    throw;
  }
  submitted_.clear();
  for (std::size_t i = 0; i < envs.size(); ++i) {
    const std::size_t env = size_of(envs[i]);
    const bool has_task = submit_step(env, actions.subspan(i * per_env, per_env));
    if (!has_task) send_state_[env] = SendState::done;  // idle: there is nothing to wait for
  }
  workers_->submit(submitted_);
}

std::span<const std::uint32_t> EnvScheduler::awaited(int min_ready, RecvOrder order) const {
  if (min_ready < 1 || size_of(min_ready) > sent_order_.size())
    throw std::invalid_argument(
        fmt::format("BatchedEnv::recv: asked for {} environments, but {} are stepping", min_ready, sent_order_.size()));
  return std::span(sent_order_).first(order == RecvOrder::as_sent ? size_of(min_ready) : sent_order_.size());
}

void EnvScheduler::wait_ready(int min_ready, RecvOrder order) {
  const std::span<const std::uint32_t> envs = awaited(min_ready, order);
  while (const auto completed = workers_->done_already()) settle(*completed);
  while (std::ranges::count_if(envs, [&](std::uint32_t env) { return is_done(env); }) < min_ready) settle(workers_->next());
}

std::span<const std::int32_t> EnvScheduler::recv(int min_ready, RecvOrder order) {
  wait_ready(min_ready, order);
  clear_finished();
  submitted_.clear();
  std::ranges::copy_if(awaited(min_ready, order), std::back_inserter(submitted_), [&](std::uint32_t env) { return is_done(env); });
  draw_pictures(submitted_);
  for (const std::uint32_t env : submitted_) send_state_[env] = SendState::at_rest;
  std::erase_if(sent_order_, [&](std::uint32_t env) { return !is_under_way(env); });
  std::ranges::sort(submitted_);
  received_.assign(submitted_.begin(), submitted_.end());
  gather(submitted_);
  gather_failed_starts(submitted_);
  return received_;
}

std::optional<FaultReport> EnvScheduler::begin(int env, std::uint64_t episode_index, int episode_count,
                                               std::optional<std::uint32_t> stream) {
  refuse_while_under_way("begin");
  const std::size_t index = index_of(env);
  const std::size_t num_episodes = parts_.setup.set->episodes.size();
  if (episode_index >= num_episodes || episode_count < 0)
    throw std::invalid_argument(fmt::format("BatchedEnv::begin: episode {} is out of range (set of {}), or episode count {} is negative",
                                            episode_index, num_episodes, episode_count));
  require_settled(index, "begin");
  Environment& begun = envs_[index];
  begun.assign(Job::begin);
  if (stream)
    begun.borrow(parts_.setup.config.seed, *stream);
  else
    begun.seed(parts_.setup.config.seed, parts_.setup.global_id(index));
  begun.name_episode(episode_index, episode_count);
  has_started_ = true;
  submitted_.assign(1, static_cast<std::uint32_t>(env));
  run_all();
  if (stalled_[index] != 0) return FaultReport{Fault::stall, stall_text(parts_.setup.config)};
  const FaultReport* found = begun.run().fault();
  if (!found) return std::nullopt;
  const FaultReport fault = *found;
  begun.go_idle();
  begun.publish();
  return fault;
}

void EnvScheduler::place(int env, const Pose& pose, int steps) {
  refuse_while_under_way("place");
  const std::size_t index = index_of(env);
  if (parts_.setup.per_env != 1) throw std::logic_error("BatchedEnv::place: environments have several agents; only single ones are placed");
  if (steps < 0 || steps >= parts_.setup.config.task.max_steps)
    throw std::invalid_argument(
        fmt::format("BatchedEnv::place: step {} is out of range: episodes have {} steps", steps, parts_.setup.config.task.max_steps));
  require_settled(index, "place");
  if (!envs_[index].run().has_episode() || envs_[index].run().has_ended())
    throw std::logic_error(fmt::format("BatchedEnv::place: environment {} is in no episode; begin one first", env));
  envs_[index].name_place(pose, steps);
  submitted_.assign(1, static_cast<std::uint32_t>(env));
  run_all();
  if (stalled_[index] != 0) throw InputError("place", stall_text(parts_.setup.config), "begin another episode once the stage has returned");
  if (const FaultReport* found = envs_[index].run().fault()) {
    const std::string detail = found->detail;
    envs_[index].go_idle();
    envs_[index].publish();
    throw InputError("place", detail, "begin another episode");
  }
}

EnvCursor EnvScheduler::cursor_of(std::size_t env) const {
  if (envs_[env].run().was_placed && envs_[env].run().has_episode())
    throw std::logic_error(fmt::format("BatchedEnv: environment {} cannot be saved: its agent was placed, by no action", env));
  return envs_[env].cursor(stalled_[env] != 0);
}

void EnvScheduler::restore(std::span<const EnvCursor> cursors, bool has_started) {
  for (const std::uint32_t env : all_envs_) require_settled(env, "restore");
  clear_finished();
  has_started_ = has_started;
  if (!has_started) return;
  submitted_.clear();
  for (const std::uint32_t env : all_envs_) {
    envs_[env].assign(cursors[env]);
    submitted_.push_back(env);
  }
  run_all();
}

void EnvScheduler::restore(std::size_t env, const EnvCursor& cursor) {
  require_settled(env, "restore");
  envs_[env].assign(cursor);
  submitted_.assign(1, static_cast<std::uint32_t>(env));
  run_all();
}

void EnvScheduler::run_all() {
  clear_finished();
  workers_->submit(submitted_);
  workers_->finish([&](CompletedEnv completed) { settle(completed); });
  draw_pictures(submitted_);
  gather(submitted_);
}

void EnvScheduler::settle(CompletedEnv completed) {
  const std::size_t env = completed.env;
  if (completed.stalled) {
    stalled_[env] = 1;
    envs_[env].give_up();
  }
  if (is_under_way(env)) send_state_[env] = SendState::done;
}

void EnvScheduler::draw_pictures(std::span<const std::uint32_t> done) {
  for (const std::uint32_t env : done) {
    if (stalled_[env] != 0) continue;  // its thread still writes there
    for (Agent& agent : envs_[env].agents()) pictures_->collect(agent);
  }
  stage_seconds_.render += pictures_->draw();
}

void EnvScheduler::finish(std::vector<FinishedEpisode>& episodes) {
  std::ranges::move(episodes, std::back_inserter(finished_));
  episodes.clear();
}

void EnvScheduler::gather(std::span<const std::uint32_t> done) {
  std::exception_ptr error;  // of the first env that has one; all are gathered before it is thrown
  for (const std::uint32_t env : done) {
    TaskResults& results = envs_[env].results();
    finish(results.given_up);
    if (stalled_[env] != 0) continue;  // its thread still writes there
    const std::span<Agent> agents = envs_[env].agents();
    for (Agent& agent : agents) {
      for (double StageSeconds::*stage : kStageSeconds) stage_seconds_.*stage += agent.seconds.*stage;
      agent.seconds = {};
      effects_[agent.row] = agent.hearing.effects();
      cached_responses_[agent.row] = agent.hearing.cached_responses();
    }
    for (std::size_t i = 0; i < results.ended.size() && !spare_actions_.empty(); ++i) {
      agents[i].spare_actions = std::move(spare_actions_.back());
      spare_actions_.pop_back();
    }
    finish(results.ended);
    if (results.error && !error) error = results.error;
    results.error = nullptr;
  }
  if (error) std::rethrow_exception(error);
  parts_.faults.check_live_environments(parts_.rows.active());
}

BatchCounters EnvScheduler::counters() const {
  BatchCounters sum{.stages = stage_seconds_, .effects = {}};
  for (const EffectCounters& effects : effects_) sum.effects.add(effects);
  for (const std::uint64_t cached : cached_responses_) sum.cached_responses += cached;
  return sum;
}

/// Episodes that could not begin are among the finished of the step or recv() that follows: callers of reset() look at no finished ones.
void EnvScheduler::gather_failed_starts(std::span<const std::uint32_t> done) {
  for (const std::uint32_t env : done)
    if (stalled_[env] == 0) finish(envs_[env].results().failed_starts);
}

/// The storage of their actions goes to episodes that end later.
void EnvScheduler::clear_finished() {
  for (FinishedEpisode& episode : finished_)
    if (spare_actions_.size() < spare_actions_.capacity()) spare_actions_.push_back(std::move(episode.actions));
  finished_.clear();
}

}  // namespace earshot
