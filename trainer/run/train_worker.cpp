// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/train_worker.h"

#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <optional>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/machine_limits.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/env_states.h"
#include "trainer/run/initial_policy.h"
#include "trainer/run/resource_need.h"
#include "trainer/run/weight_check.h"

namespace earshot {
namespace {

EnvConfig training_env(const RunConfig& config) {
  EnvConfig env = config.env;
  env.order = EpisodeOrder::random;
  env.observation = training_sensors(config);
  if (env.quarantine_dir.empty()) env.quarantine_dir = (std::filesystem::path(config.out) / "quarantine").string();
  return env;
}

}  // namespace

WorkerStart worker_start(const Collective& collective, const std::filesystem::path& resume, const std::vector<std::string>& changes) {
  WorkerStart start;
  if (!resume.empty()) start.resumed = load_checkpoint(resume);
  const int world_size = collective.identity().world_size;
  if (collective.is_joining()) {
    start.briefing = decode_briefing(collective.briefing(), world_size);
    start.places = {start.briefing.places, start.briefing.started_workers, false};
  } else {
    start.places = env_places_of(start.resumed, world_size, changes);
  }
  return start;
}

TrainWorker::TrainWorker(const RunConfig& config, Collective& collective, WorkerStart start, const std::filesystem::path& resume,
                         RunClaim claim, const TrainHooks& hooks)
    : config_(config),
      collective_(collective),
      places_(std::move(start.places)),
      set_(std::make_shared<const EpisodeSet>(load_episode_set(config.train.file))),
      scenes_(make_scene_cache(config.env)),
      env_(training_env(config), set_, scenes_, config.envs_per_worker, first_env(), places_.started_workers * config.envs_per_worker),
      policy_(make_policy(config.env.observation, config.policy)),
      learner_(policy_, config.ppo, config.seed, config.guidance, static_cast<double>(config.env.task.success_radius_m)),
      collector_(rollout_config(config), env_, policy_, first_env()),
      preemption_(config.ppo, config.rollout_steps),
      progress_(config),
      report_(config, collective, progress_, std::move(claim)),
      recovery_(collective, places_, policy_, learner_, progress_, report_),
      held_out_(config.held_out.is_on() ? hooks.held_out : nullptr) {
  EARSHOT_EXPECT(!config.held_out.is_on() || held_out_ != nullptr);
  env_.set_stage_hook(hooks.stage_hook);
  recovery_.brief();
  if (collective.is_joining()) {
    join(start.briefing);
    return;
  }
  if (start.resumed) {
    restore(*start.resumed, resume);
  } else {
    if (!config.initial_policy.empty()) load_initial_policy(config, policy_);
    env_.reset();
  }
  if (held_out_ != nullptr) report_.restore_held_out(start.resumed ? start.resumed->held_out : std::nullopt, held_out_->identity());
  start.resumed.reset();
  check_equal_weights(collective, policy_);
}

void TrainWorker::restore(const Checkpoint& checkpoint, const std::filesystem::path& path) {
  load_learner_state(policy_, learner_.optimizer(), checkpoint, path.string());
  report_.restore_window(checkpoint);
  progress_.set_position({.update = checkpoint.update,
                          .env_steps = checkpoint.env_steps,
                          .steps_before = checkpoint.env_steps,
                          .elapsed_s = 0,
                          .elapsed_before_s = checkpoint.elapsed_s});
  if (places_.are_moved)
    move_env_states(checkpoint, path, collective_.identity(), config_.seed, set_->hash, env_, collector_);
  else
    restore_env_states(checkpoint, path, collective_.identity(), env_, collector_);
}

/// The environments begin where no worker has been: by their number and the update, other episodes than those of the start or of a worker
/// that joined before.
void TrainWorker::join(const JoinBriefing& briefing) {
  std::vector<std::uint64_t> seeds;
  for (int env = 0; env < config_.envs_per_worker; ++env)
    seeds.push_back(hash64(fmt::format("joins {} {}", first_env() + env, briefing.update), config_.seed));
  env_.reset(std::vector<std::uint8_t>(seeds.size(), 1), seeds);
  collective_.enter();
  recovery_.recover(MembershipChange({}));
}

TrainReport TrainWorker::run() {
  if (rank() == 0 && report_.open_files())
    std::fputs(fmt::format("training {}: {} workers x {} envs, {} episodes, {} parameters\n", config_.name,
                           collective_.identity().world_size, config_.envs_per_worker, set_->episodes.size(), policy_->num_parameters())
                   .c_str(),
               stderr);  // fmt::print would throw where the output is closed
  progress_.start_clock();
  try {
    make_updates();
  } catch (const LeftOut&) {  // the others go on
    throw;
  } catch (...) {
    salvage();
    throw;
  }
  const RunPosition& end = progress_.position();
  return {
      end.update,         end.env_steps,    end.elapsed_s,     progress_.steps_per_s(), report_.last_checkpoint(), progress_.end_signal(),
      report_.counters(), report_.guards(), report_.held_out()};
}

void TrainWorker::make_updates() {
  for (bool saved = false; !saved;) try {
      if (!whole_ && !collective_.survives_loss()) keep_whole_update(keeps_environments());
      while (!progress_.agree_on_end(collective_, held_out_vote())) {
        if (progress_.has_joiners()) collective_.admit();
        if (progress_.evaluates())
          evaluate();
        else
          update();
      }
      save(true);
      collective_.barrier();  // no worker says that the run has ended before its last checkpoint is on disk
      saved = true;
    } catch (const MembershipChange& change) {
      whole_.reset();  // of other members
      recovery_.recover(change);
    }
}

/// Rank 0's counts for all: of workers that were lost and came back the others may know less.
HeldOutVote TrainWorker::held_out_vote() const {
  if (held_out_ == nullptr) return {};
  const HeldOutState& state = report_.held_out();
  const bool in_minutes = config_.schedule == Schedule::minutes;
  const double training = in_minutes ? progress_.total_elapsed_s() - state.seconds : static_cast<double>(progress_.env_steps());
  const double spent = in_minutes ? state.seconds : static_cast<double>(state.env_steps);
  const double last = in_minutes ? state.last_seconds : static_cast<double>(state.last_env_steps);
  return {.evaluates = !progress_.has_rollout() && is_due(config_.held_out, state, progress_.update()) &&
                       is_within_fraction(config_.held_out.max_fraction, spent, last, training),
          .has_stopped = has_stopped_learning(config_.held_out, state)};
}

void TrainWorker::evaluate() {
  const auto scores = held_out_->evaluate(policy_, collective_);
  progress_.complete_evaluation();
  if (!scores) return;
  const HeldOutScore& chosen = config_.eval_actions == ActionChoice::argmax ? scores->argmax : scores->sample;
  const HeldOutState before = report_.held_out(), local = after_evaluation(before, progress_.update(), *scores, chosen);
  const HeldOutState agreed = decode_held_out(collective_.all_gather(encode_held_out(local)).front());
  report_.set_held_out(agreed);
  if (whole_) report_.describe_state(*whole_);
  try {
    if (agreed.best_update == progress_.update()) save(false);
  } catch (const MembershipChange&) {
    report_.set_held_out(before);  // made again by those that are left: the best weights must be on disk
    throw;
  }
  report_.show_held_out(*scores);
}

void TrainWorker::update() {
  if (!can_map(kWorkingBytes))  // before a library finds out, and ends the process or tries for ever
    throw RunError(worker_name(collective_.members()[static_cast<std::size_t>(rank())]),
                   fmt::format("is out of memory before update {}", progress_.update() + 1));
  if (!progress_.has_rollout()) collect();
  const std::uint64_t steps = collected_steps();
  const UpdateStats stats = learn();
  const bool is_sound = !rolls_back();
  const double update_s = progress_.complete_update(steps);
  recovery_.brief();
  if (const auto failure = report_.note(stats)) {
    keep_whole_update(true);
    save(true);
    collective_.barrier();  // who throws stops the others: not before rank 0 has all parts of the checkpoint, and has written it
    throw RunError("training", *failure);
  }
  report(stats, update_s, steps);
  if (is_sound) roll_backs_ = 0;
  keep_whole_update(keeps_environments());
  // The first checkpoint comes early, so that faults of the disk appear before much work is lost.
  const bool is_due = progress_.update() == 1 || progress_.update() % static_cast<std::uint64_t>(config_.checkpoint_every) == 0;
  if (is_due)
    save(false);
  else if (rank() == 0 && keeps_environments() && report_.owes_checkpoint())
    report_.save(*whole_, false);
}

void TrainWorker::collect() {
  LapTimer watch;
  const int world_size = collective_.identity().world_size;
  collect_s_ = 0;
  collector_.collect(progress_.fraction(), sums_.episodes, sums_.times, [&](int step) {
    collective_.note_progress();
    collect_s_ += watch.lap();
    return preemption_.may_end_with(step) && preemption_.ends_with(step, collect_s_, collective_.num_waiting(), world_size);
  });
  progress_.note_rollout();
  collect_s_ += watch.lap();
}

/// Of all workers in this update.  With preemption a call in which those that have their rollouts wait for the others.
std::uint64_t TrainWorker::collected_steps() {
  const auto num_envs = static_cast<std::uint64_t>(config_.envs_per_worker);
  if (!preemption_.is_on())
    return static_cast<std::uint64_t>(config_.rollout_steps) * num_envs * static_cast<std::uint64_t>(collective_.identity().world_size);
  std::uint64_t steps = 0;
  for (const auto& text : collective_.all_gather(std::to_string(collector_.rollout().num_steps()))) steps += std::stoull(text);
  return steps * num_envs;
}

UpdateStats TrainWorker::learn() {
  recovery_.begin_update();
  const UpdateStats stats = learner_.update(collector_.rollout(), progress_.fraction(), progress_.update(), collective_);
  recovery_.end_update();
  sums_.times.learn += stats.learn_s;
  sums_.times.reduce += stats.reduce_s;
  return stats;
}

void TrainWorker::report(const UpdateStats& stats, double update_s, std::uint64_t steps) {
  sums_.counters = RunCounters::of(env_, *scenes_, collector_.sanitized_rows(), collector_.dropped_rows(), report_.ratio_alarms());
  const std::vector<WorkerUpdate> of_all =
      gather_worker_updates(collective_, {.update_s = update_s,
                                          .collect_s = collect_s_,
                                          .rollout_steps = static_cast<double>(collector_.rollout().num_steps()),
                                          .episodes = sums_.episodes.values[EpisodeSums::count],
                                          .stopped = sums_.episodes.values[EpisodeSums::stopped],
                                          .explained_variance = stats.explained_variance,
                                          .approx_kl = stats.approx_kl,
                                          .clip_fraction = stats.clip_fraction});
  std::vector<RolloutTime> rollouts;
  for (const WorkerUpdate& worker : of_all) rollouts.push_back({worker.collect_s, static_cast<int>(worker.rollout_steps)});
  preemption_.note_update(rollouts);
  report_.report(stats, sums_, of_all, static_cast<double>(steps) / update_s);
  sums_ = {};
}

/// What a checkpoint of this update has to hold, on every worker, so that any of them can write it once the others are lost.
void TrainWorker::keep_whole_update(bool with_environments) {
  Checkpoint state = learner_state_of(policy_, learner_.optimizer());
  state.module = policy_->module_file();
  if (with_environments) gather_env_states(collective_, env_, collector_, state);
  for (const int member : collective_.members()) state.members.push_back(places_.first_of(member));
  state.started_workers = places_.started_workers;
  report_.describe_state(state);
  whole_ = std::move(state);
}

void TrainWorker::save(bool is_last) {
  check_equal_weights(collective_, policy_);  // else the checkpoint would be of no worker
  if (!whole_ || whole_->env_states.empty()) keep_whole_update(true);
  if (rank() == 0) report_.save(*whole_, is_last);
}

/// After the steps of an update.  Weights that have gone bad end the run at the last good ones, or are put back to them and the run goes
/// on; false where they are sound.
bool TrainWorker::rolls_back() {
  const auto fault = fault_of_weights(policy_);
  if (!fault) return false;
  std::string message = fmt::format("update {}: the weights have gone bad: {}; the likeliest reason is {}", progress_.update() + 1, *fault,
                                    suspect_key(config_));
  if (whole_) load_learner_state(policy_, learner_.optimizer(), *whole_, "the update before");
  if (whole_ && roll_backs_ < config_.ppo.roll_backs) {
    ++roll_backs_;
    if (rank() == 0) log_warning(fmt::format("{}; the run goes on from those of update {}", message, whole_->update));
    return true;
  }
  if (whole_ && !whole_->env_states.empty()) {
    if (rank() == 0) report_.save(*whole_, true);
    message += fmt::format("; last.ckpt holds update {}, the last good one", whole_->update);
  }
  collective_.barrier();  // who throws stops the others: not before the checkpoint is written
  throw RunError("training", message);
}

void TrainWorker::salvage() noexcept {
  try {
    if (whole_ && !whole_->env_states.empty()) report_.salvage(*whole_);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "earshot: the last update could not be saved: %s\n", error.what());
  }
}

}  // namespace earshot
