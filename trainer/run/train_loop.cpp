#include "trainer/run/train_loop.h"

#include <fmt/format.h>

#include <array>

#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/net/stop_signals.h"
#include "trainer/run/initial_policy.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_worker.h"

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

TrainWorker::TrainWorker(const RunConfig& config, Collective& collective, const std::filesystem::path& resume,
                         const std::vector<std::string>& changes, const TrainHooks& hooks)
    : config_(config),
      collective_(collective),
      rank_(collective.identity().rank),
      world_(collective.identity().world_size),
      resumed_(resume.empty() ? std::nullopt : std::optional<Checkpoint>(load_checkpoint(resume))),
      joins_(collective.is_joining()),
      briefing_(joins_ ? decode_briefing(collective.briefing(), world_) : JoinBriefing{}),
      places_(joins_ ? EnvPlaces{briefing_.places, briefing_.started_workers, false} : env_places_of(resumed_, world_, changes)),
      set_(std::make_shared<const EpisodeSet>(load_episode_set(config.train.file))),
      scenes_(make_scene_cache(config.env)),
      env_(training_env(config), set_, scenes_, config.envs_per_worker, places_.first_of(rank_) * config.envs_per_worker,
           places_.started_workers * config.envs_per_worker),
      policy_(config.env.observation, config.policy),
      learner_(policy_, config.ppo, config.seed, config.guidance, static_cast<double>(config.env.task.success_radius_m)),
      collector_(rollout_config(config), env_, policy_, places_.first_of(rank_) * config.envs_per_worker),
      preemption_(config.ppo, config.rollout_steps) {
  env_.set_stage_hook(hooks.stage_hook);
  brief();
  if (joins_) {
    begin_other_episodes();
    collective.enter();
    recover(MembershipChange({}));
    return;
  }
  if (resume.empty()) {
    if (!config.initial_policy.empty()) load_initial_policy(config, policy_);
    env_.reset();
  } else {
    restore(resume);
    resumed_.reset();
  }
  check_equal_weights();
}

void TrainWorker::restore(const std::filesystem::path& path) {
  const Checkpoint& checkpoint = *resumed_;
  load_learner(checkpoint, path.string());
  window_.restore(checkpoint.episode_window, checkpoint.episode_window_fields);
  update_ = checkpoint.update;
  env_steps_ = steps_before_ = checkpoint.env_steps;
  elapsed_before_s_ = checkpoint.elapsed_s;
  if (places_.begin_anew) {
    env_.reset();
    return;
  }
  if (checkpoint.env_states.size() != static_cast<std::size_t>(world_))
    throw InputError(path.string(), fmt::format("holds {} workers' environments, of {} workers", checkpoint.env_states.size(), world_),
                     "take an earlier checkpoint");
  const auto rank = static_cast<std::size_t>(rank_);
  if (!torch::isfinite(checkpoint.hidden.at(rank)).all().item<bool>())
    throw InputError(path.string(), "holds a recurrent state that is not finite", "take an earlier checkpoint");
  env_.restore(checkpoint.env_states[rank]);
  collector_.restore(checkpoint.hidden.at(rank), checkpoint.not_done.at(rank),
                     checkpoint.oracle_acted.empty() ? torch::Tensor() : checkpoint.oracle_acted.at(rank));
}

void TrainWorker::check_equal_weights() {
  const std::string hash = hex64(hash_of(weights_of(policy_)));
  for (const auto& other : collective_.all_gather(hash))
    if (other != hash) throw RunError("workers", "hold different weights; are they the same program, config and seed, on sound memory?");
}

bool TrainWorker::finished() {
  // One worker's clock or signal must stop all at the same update: the sum of stop votes decides.
  const bool stops = StopSignals::received() || env_steps_ >= config_.total_steps ||
                     (rank_ == 0 && config_.max_minutes > 0 && bounded_s() >= config_.max_minutes * 60);
  std::array<double, 3> votes{stops ? 1.0 : 0.0, rank_ == 0 ? own_progress() : 0.0, collective_.has_joiners() ? 1.0 : 0.0};
  collective_.all_reduce_sum(std::span<double>(votes));
  progress_ = votes[1];
  joiners_ = votes[2] > 0;
  return votes[0] > 0;
}

/// Of all workers in this update.  With preemption a call in which those that have their rollouts wait for the others.
std::uint64_t TrainWorker::collected_steps() {
  if (!preemption_.is_on()) return steps_per_update();
  std::uint64_t steps = 0;
  for (const auto& text : collective_.all_gather(std::to_string(collector_.rollout().num_steps()))) steps += std::stoull(text);
  return steps * static_cast<std::uint64_t>(config_.envs_per_worker);
}

UpdateStats TrainWorker::learn() {
  if (collective_.survives_loss()) remember();
  learning_ = true;
  const UpdateStats stats = learner_.update(collector_.rollout(), progress_, update_, collective_);
  learning_ = false;
  times_.learn += stats.learn_s;
  times_.reduce += stats.reduce_s;
  return stats;
}

void TrainWorker::update() {
  if (!collected_) {
    LapTimer watch;
    own_step_s_ = 0;
    collector_.collect(progress_, finished_, times_, [&](int step) {
      collective_.note_progress();
      own_step_s_ += watch.lap();
      return preemption_.may_end_with(step) && preemption_.ends_with(step, own_step_s_, collective_.num_waiting(), world_);
    });
    collected_ = true;
    own_step_s_ += watch.lap();
  }
  const std::uint64_t steps = collected_steps();
  const UpdateStats stats = learn();
  collected_ = false;
  ++update_;
  env_steps_ += steps;
  brief();
  const double update_s = clock_.lap();
  elapsed_s_ += update_s;
  note(stats);
  report(stats, update_s, steps);
  if (update_ % static_cast<std::uint64_t>(config_.checkpoint_every) == 0) save(false);
}

TrainReport TrainWorker::run() {
  if (rank_ == 0 && !files_) {
    files_.emplace(config_, update_);
    fmt::print(stderr, "training {}: {} workers x {} envs, {} episodes, {} parameters\n", config_.name, world_, config_.envs_per_worker,
               set_->episodes.size(), policy_->num_parameters());
  }
  clock_.lap();
  for (bool saved = false; !saved;) try {
      while (!finished()) {
        if (joiners_) collective_.admit();
        update();
      }
      save(true);
      saved = true;
    } catch (const MembershipChange& change) {
      recover(change);
    }
  return {update_,          env_steps_, elapsed_s_, elapsed_s_ > 0 ? static_cast<double>(env_steps_ - steps_before_) / elapsed_s_ : 0,
          last_checkpoint_, counters_,  guards_};
}

TrainReport train(const RunConfig& config, Collective& collective, const RunStart& start, const TrainHooks& hooks) {
  // One thread per worker: the fast setting on shared cores, and the one that gives the same bits (docs/ppo.md, section 4).
  use_one_torch_thread();
  if (collective.is_joining())
    refuse_stale_episodes(config, start);
  else
    prepare_run(config, start, collective);
  if (collective.identity().rank == 0 && !collective.is_joining() && !start.note.empty()) fmt::print("{}\n", start.note);
  const StopSignals signals;
  // A worker that joins gets from the others what they have made of the checkpoint.
  return TrainWorker(config, collective, collective.is_joining() ? std::filesystem::path() : start.resume, start.changes, hooks).run();
}

}  // namespace earshot
