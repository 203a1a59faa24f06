#include "trainer/train_loop.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <future>
#include <limits>
#include <numeric>
#include <optional>
#include <sstream>
#include <utility>

#include "envs/engine_commit.h"
#include "policy/torch_threads.h"
#include "sim/base/files.h"
#include "trainer/checkpoint.h"
#include "trainer/checkpoint_keeper.h"
#include "trainer/curve_svg.h"
#include "trainer/episode_window.h"
#include "trainer/event_log.h"
#include "trainer/initial_policy.h"
#include "trainer/metrics_file.h"
#include "trainer/ppo.h"
#include "trainer/preemption.h"
#include "trainer/result.h"
#include "trainer/rollout_collector.h"
#include "trainer/run_folder.h"
#include "trainer/run_state.h"
#include "trainer/stage_times.h"
#include "trainer/stop_signals.h"
#include "trainer/update_curves.h"

namespace earshot {
namespace {

constexpr int kMaxUpdatesWithoutStep = 20;  // in a row, before a run that learns nothing is ended
constexpr std::uint64_t kLoggedSkips = 20;  // one line each; the others are counted

/// Everything one worker holds during a run.
class Worker {
 public:
  Worker(const RunConfig& config, Collective& collective, const std::filesystem::path& resume, const std::vector<std::string>& changes,
         const TrainHooks& hooks)
      : config_(config),
        collective_(collective),
        rank_(collective.identity().rank),
        world_(collective.identity().world_size),
        resumed_(resume.empty() ? std::nullopt : std::optional<Checkpoint>(load_checkpoint(resume))),
        joins_(collective.is_joining()),
        briefing_(joins_ ? decode_briefing(collective.briefing(), world_) : JoinBriefing{}),
        places_(joins_ ? Places{briefing_.places, briefing_.started_workers, false} : places_of_envs(resumed_, world_, changes)),
        set_(std::make_shared<const EpisodeSet>(load_episode_set(config.train.file))),
        scenes_(make_scene_cache(config.env)),
        env_(training_env(config), set_, scenes_, config.envs_per_worker, places_.first_of(rank_) * config.envs_per_worker,
             places_.started_workers * config.envs_per_worker),
        policy_(config.env.observation, config.policy),
        learner_(policy_, config.ppo, config.seed, config.guidance, static_cast<double>(config.env.task.success_radius_m)),
        collector_(config, env_, policy_, places_.first_of(rank_) * config.envs_per_worker),
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

  TrainReport run();

 private:
  static EnvConfig training_env(const RunConfig& config) {
    EnvConfig env = config.env;
    env.order = EpisodeOrder::random;
    env.observation = training_sensors(config);
    if (env.quarantine_dir.empty()) env.quarantine_dir = (std::filesystem::path(config.out) / "quarantine").string();
    return env;
  }
  /// Which part of the environments each rank has (Checkpoint::members).
  struct Places {
    std::vector<int> members;
    int started_workers = 0;
    bool begin_anew = false;  ///< the checkpoint's are of another number of workers
    [[nodiscard]] int first_of(int rank) const { return members[static_cast<std::size_t>(rank)]; }
  };
  static Places places_of_envs(const std::optional<Checkpoint>& resumed, int world, const std::vector<std::string>& changes);
  void restore(const std::filesystem::path& path);
  void update();
  void begin_files();
  void begin_other_episodes();
  void remember();
  void go_back();
  void recover(const MembershipChange& change);
  bool agree_on_state();
  [[nodiscard]] std::string state();
  void take_state(const std::string& bytes);
  void leave_files();
  void brief();
  void check_equal_weights();
  UpdateStats learn();
  void note(UpdateStats stats);
  std::uint64_t collected_steps();
  void report(const UpdateStats& stats, double update_s, std::uint64_t steps);
  /// What a worker says of its own update; travels as it lies in memory.
  struct OwnUpdate {
    double update_s, collect_s, rollout_steps, episodes, stopped, explained_variance, approx_kl, clip_fraction;
  };
  [[nodiscard]] std::vector<OwnUpdate> of_all_workers(const OwnUpdate& own);
  void append_workers(std::vector<std::pair<std::string, double>>& values, const std::vector<OwnUpdate>& of_all) const;
  void save(bool last);
  void finish_writing();
  template <class Write>
  static bool written(const Write& write);
  template <class Write>
  void write_or_go_on(const Write& write);
  bool finished();

  /// Of this worker's clock: rank 0's holds for all.
  [[nodiscard]] double own_progress() const {
    const double by_steps = static_cast<double>(env_steps_) / static_cast<double>(config_.total_steps);
    const double by_time = config_.schedule == Schedule::minutes ? total_elapsed_s() / (60 * config_.max_minutes) : 0;
    return std::min(1.0, std::max(by_steps, by_time));
  }
  [[nodiscard]] double total_elapsed_s() const { return elapsed_before_s_ + elapsed_s_; }
  /// Wall time that max_minutes bounds: of this sitting, or with a schedule of minutes of the whole run.
  [[nodiscard]] double bounded_s() const { return config_.schedule == Schedule::minutes ? total_elapsed_s() : elapsed_s_; }
  [[nodiscard]] std::uint64_t steps_per_update() const {
    return static_cast<std::uint64_t>(config_.rollout_steps) * static_cast<std::uint64_t>(config_.envs_per_worker) *
           static_cast<std::uint64_t>(world_);
  }

  /// The whole update before the one under way: what is left of it when a worker is lost.
  struct Before {
    std::uint64_t update = 0, env_steps = 0;
    Checkpoint learner;  ///< weights and optimizer
    GuardCounts guards;
    int updates_without_step = 0;
  };

  const RunConfig& config_;
  Collective& collective_;
  int rank_, world_;
  std::optional<Checkpoint> resumed_;  ///< until it is restored
  bool joins_;                         ///< has not got the state of the run yet
  JoinBriefing briefing_;
  const Places places_;  ///< by rank at this start
  std::shared_ptr<const EpisodeSet> set_;
  std::shared_ptr<SceneCache> scenes_;
  BatchedEnv env_;
  ActorCritic policy_;
  PpoLearner learner_;
  RolloutCollector collector_;
  Preemption preemption_;

  std::uint64_t update_ = 0, env_steps_ = 0;
  bool collected_ = false;  ///< the rollout of the update under way is there
  bool learning_ = false;   ///< the weights are in the midst of an update
  std::optional<Before> before_;
  bool lost_since_report_ = false;
  bool joiners_ = false;  ///< some are ready
  EpisodeSums finished_;
  EpisodeWindow window_;
  StageTimes times_;  ///< this update, this worker
  std::filesystem::path last_checkpoint_;
  std::future<std::uint64_t> writing_;  ///< rank 0's checkpoint on its way to the disk; what of it failed
  std::optional<EventLog> events_;
  std::optional<CheckpointKeeper> checkpoints_;  ///< rank 0's
  RunCounters counters_;                         ///< of all workers
  GuardCounts guards_;
  int updates_without_step_ = 0;  ///< in a row
  std::uint64_t ratio_alarms_ = 0;
  LapTimer clock_;
  double own_step_s_ = 0;                        ///< seconds of this worker's rollout
  double elapsed_s_ = 0, elapsed_before_s_ = 0;  ///< in this sitting, and in those before
  double progress_ = 0;                          ///< of all workers, in [0, 1]
};

Worker::Places Worker::places_of_envs(const std::optional<Checkpoint>& resumed, int world, const std::vector<std::string>& changes) {
  Places places;
  if (resumed && resumed->world_size == world && !resumed->members.empty()) return {resumed->members, resumed->started_workers, false};
  places.members.resize(static_cast<std::size_t>(world));
  std::iota(places.members.begin(), places.members.end(), 0);
  places.started_workers = world;
  if (!resumed || resumed->world_size == world) return places;
  if (std::ranges::find(changes, "workers") == changes.end())
    throw InputError(fmt::format("checkpoint of update {}", resumed->update),
                     fmt::format("is of a run with {} workers, this one has {}", resumed->world_size, world),
                     "resume with as many workers, or declare the change with --change workers");
  places.begin_anew = true;
  return places;
}

void Worker::restore(const std::filesystem::path& path) {
  const Checkpoint& checkpoint = *resumed_;
  load_weights(policy_, checkpoint, path.string());
  load_optimizer_state(policy_, learner_.optimizer(), checkpoint);
  window_.restore(checkpoint.episode_window, checkpoint.episode_window_fields);
  update_ = checkpoint.update;
  env_steps_ = checkpoint.env_steps;
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

void Worker::remember() {
  Before before{
      .update = update_, .env_steps = env_steps_, .learner = {}, .guards = guards_, .updates_without_step = updates_without_step_};
  before.learner.architecture = policy_->architecture();
  before.learner.weights = weights_of(policy_);
  before.learner.optimizer = optimizer_state_of(policy_, learner_.optimizer());
  before_ = std::move(before);
}

void Worker::go_back() {
  load_weights(policy_, before_->learner, "the update before");
  load_optimizer_state(policy_, learner_.optimizer(), before_->learner);
  update_ = before_->update;
  env_steps_ = before_->env_steps;
  const std::uint64_t lost = guards_.lost_workers;
  guards_ = before_->guards;
  guards_.lost_workers = lost;
  updates_without_step_ = before_->updates_without_step;
  collected_ = true;
}

/// The environments begin where no worker has been: by their number and the update, other episodes than those of the start or of a worker
/// that joined before.
void Worker::begin_other_episodes() {
  std::vector<std::uint64_t> seeds;
  for (int env = 0; env < config_.envs_per_worker; ++env)
    seeds.push_back(
        hash64(fmt::format("joins {} {}", places_.first_of(rank_) * config_.envs_per_worker + env, briefing_.update), config_.seed));
  env_.reset(std::vector<std::uint8_t>(seeds.size(), 1), seeds);
}

std::string Worker::state() {
  RunState state;
  state.learner.architecture = policy_->architecture();
  state.learner.weights = weights_of(policy_);
  state.learner.optimizer = optimizer_state_of(policy_, learner_.optimizer());
  state.learner.update = update_;
  state.learner.env_steps = env_steps_;
  state.learner.episode_window = window_.state();
  state.learner.episode_window_fields = EpisodeSums::num_fields;
  state.guards = guards_;
  state.counters = counters_;
  state.updates_without_step = updates_without_step_;
  state.elapsed_s = elapsed_s_;
  state.elapsed_before_s = elapsed_before_s_;
  return encode_run_state(state);
}

void Worker::take_state(const std::string& bytes) {
  const RunState state = decode_run_state(bytes);
  load_weights(policy_, state.learner, "the state of the run");
  load_optimizer_state(policy_, learner_.optimizer(), state.learner);
  window_.restore(state.learner.episode_window, state.learner.episode_window_fields);
  update_ = state.learner.update;
  env_steps_ = state.learner.env_steps;
  guards_ = state.guards;
  counters_ = state.counters;
  updates_without_step_ = state.updates_without_step;
  elapsed_s_ = state.elapsed_s;
  elapsed_before_s_ = state.elapsed_before_s;
}

/// Brings all to the same state: the last update that all members have completed, which workers that join get from the first of the others.
/// Members differ by one call at most, so that by one update at most.  False where a worker that joins has to leave again.
bool Worker::agree_on_state() {
  constexpr const char* kJoins = "joins";
  const auto of_all =
      collective_.all_gather(joins_ ? std::string(kJoins) : fmt::format("{} {} {}", update_, guards_.lost_workers, guards_.joined_workers));
  std::vector<int> joining;
  std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  int source = -1;
  for (std::size_t place = 0; place < of_all.size(); ++place) {
    if (of_all[place] == kJoins) {
      joining.push_back(static_cast<int>(place));
      continue;
    }
    if (source < 0) source = static_cast<int>(place);
    std::uint64_t update = 0, lost = 0, joined = 0;
    if (!(std::istringstream(of_all[place]) >> update >> lost >> joined))
      throw RunError(fmt::format("worker {}", collective_.members()[place]), "does not say how far it is");
    last = std::min(last, update);
    // A change that some have not seen, as another one followed it at once.
    guards_.lost_workers = std::max(guards_.lost_workers, lost);
    guards_.joined_workers = std::max(guards_.joined_workers, joined);
  }
  if (source < 0) throw RunError("workers", "all that had the state of the run were lost; go on with --resume");
  if (!joins_ && (update_ > last || learning_)) {
    if (!before_ || before_->update != last)
      throw RunError("workers", fmt::format("are at updates {} and {}, too far from each other", last, update_));
    go_back();
  }
  learning_ = false;
  if (!joining.empty()) {
    const std::string bytes = collective_.hand_over(source, joining, rank_ == source ? state() : std::string());
    if (joins_) take_state(bytes);
  }

  Checkpoint learner;
  learner.weights = weights_of(policy_);
  learner.optimizer = optimizer_state_of(policy_, learner_.optimizer());
  const auto hashes = collective_.all_gather(hash_of_learner(learner));
  const std::string& right = hashes[static_cast<std::size_t>(source)];
  bool equal = true;
  for (std::size_t place = 0; place < hashes.size(); ++place) {
    if (hashes[place] == right) continue;
    equal = false;
    if (std::ranges::find(joining, static_cast<int>(place)) == joining.end() || (joins_ && static_cast<int>(place) == rank_))
      throw RunError("workers", "hold different weights; are they the same program, config and seed, on sound memory?");
  }
  if (equal && std::exchange(joins_, false)) collective_.confirm_join();
  return equal;
}

void Worker::recover(const MembershipChange& change) {
  std::vector<int> lost = change.lost(), joined = change.joined();
  const bool joins = joins_;
  const auto count = [&](const MembershipChange& one) {
    guards_.lost_workers += one.lost().size();
    guards_.joined_workers += one.joined().size();
  };
  count(change);
  while (true) try {
      rank_ = collective_.identity().rank;
      world_ = collective_.identity().world_size;
      if (rank_ != 0) leave_files();
      if (agree_on_state()) break;
      collective_.barrier();  // until the worker that holds something else has gone
    } catch (const MembershipChange& next) {
      count(next);
      lost.insert(lost.end(), next.lost().begin(), next.lost().end());
      joined.insert(joined.end(), next.joined().begin(), next.joined().end());
    }
  if (joins) joined.push_back(collective_.members()[static_cast<std::size_t>(rank_)]);
  lost_since_report_ = lost_since_report_ || !lost.empty();
  brief();
  if (rank_ != 0) return;
  if (!events_) begin_files();
  const auto named = [](const std::vector<int>& ranks) {
    return ranks.empty() ? std::string("none") : fmt::format("{}", fmt::join(ranks, ", "));
  };
  spdlog::warn("update {}: lost worker {}, joined worker {}; worker {} go on", update_, named(lost), named(joined),
               fmt::join(collective_.members(), ", "));
}

/// Of a worker that has written the run, once a lower one has joined.
void Worker::leave_files() {
  if (!events_) return;
  finish_writing();
  events_.reset();
  checkpoints_.reset();
}

void Worker::brief() {
  if (collective_.survives_loss() && !collective_.is_joining())
    collective_.brief(encode_briefing({places_.members, places_.started_workers, update_}));
}

void Worker::check_equal_weights() {
  const std::string hash = hex64(hash_of(weights_of(policy_)));
  for (const auto& other : collective_.all_gather(hash))
    if (other != hash) throw RunError("workers", "hold different weights; are they the same program, config and seed, on sound memory?");
}

UpdateStats Worker::learn() {
  if (collective_.survives_loss()) remember();
  learning_ = true;
  const UpdateStats stats = learner_.update(collector_.rollout(), progress_, update_, collective_);
  learning_ = false;
  times_.learn += stats.learn_s;
  times_.reduce += stats.reduce_s;
  return stats;
}

/// Books what the guards of one update did.  The statuses are those of all workers, so rank 0 can name any.
void Worker::note(UpdateStats stats) {
  const std::vector<int> members = collective_.members();  // messages name workers by the ranks with which they began
  for (SkippedStep& step : stats.skipped)
    for (int& faulty : step.faulty_ranks) faulty = members[static_cast<std::size_t>(faulty)];
  if (stats.alarm_rank >= 0) stats.alarm_rank = members[static_cast<std::size_t>(stats.alarm_rank)];
  if (rank_ == 0) {
    for (std::size_t i = 0; i < stats.skipped.size() && guards_.skipped_steps + i < kLoggedSkips; ++i)
      spdlog::warn("update {}, epoch {}, minibatch {}: no worker takes the step: {}{}", update_, stats.skipped[i].epoch,
                   stats.skipped[i].minibatch, describe(stats.skipped[i]),
                   guards_.skipped_steps + i + 1 == kLoggedSkips ? " (further ones are counted only)" : "");
    if (stats.alarm_rank >= 0 && guards_.loss_alarms + guards_.kl_alarms == 0)
      spdlog::warn(
          "update {}, worker {}: a loss of {:.4g} and a KL divergence of {:.4g} (alarms at {} and {}; further ones are counted only)",
          update_, stats.alarm_rank, stats.alarm_loss, stats.alarm_kl, config_.ppo.loss_alarm, config_.ppo.kl_alarm);
  }
  if (stats.max_ratio_error > kMaxRatioError && ratio_alarms_++ == 0)
    spdlog::warn(
        "update {}, worker {}: before the first step the learner's probabilities differ from the rollout's by {:.2g} of them: a mask, a "
        "hidden state or an observation is not what the policy acted on (further updates are counted only)",
        update_, members[static_cast<std::size_t>(rank_)], stats.max_ratio_error);
  guards_.taken_steps += static_cast<std::uint64_t>(stats.taken_steps);
  guards_.skipped_steps += stats.skipped.size();
  guards_.loss_alarms += static_cast<std::uint64_t>(stats.loss_alarms);
  guards_.kl_alarms += static_cast<std::uint64_t>(stats.kl_alarms);
  updates_without_step_ = stats.taken_steps > 0 ? 0 : updates_without_step_ + 1;
  if (updates_without_step_ < kMaxUpdatesWithoutStep) return;
  save(true);
  collective_.barrier();  // who throws stops the others: not before rank 0 has all parts of the checkpoint, and has written it
  throw RunError(
      "training",
      fmt::format("{} updates in a row took no step, at last because {}; resume from an earlier checkpoint, with a smaller learning rate",
                  updates_without_step_, stats.skipped.empty() ? "no row counted" : describe(stats.skipped.back())));
}

/// A full disk must not end a run that may find space again: false, and logged.
template <class Write>
bool Worker::written(const Write& write) {
  try {
    write();
    return true;
  } catch (const std::exception& error) {
    spdlog::error("{}; training goes on", error.what());
    return false;
  }
}

template <class Write>
void Worker::write_or_go_on(const Write& write) {
  if (!written(write)) ++guards_.failed_writes;
}

void Worker::finish_writing() {
  if (writing_.valid()) guards_.failed_writes += writing_.get();
}

std::vector<Worker::OwnUpdate> Worker::of_all_workers(const OwnUpdate& own) {
  std::string bytes(sizeof(own), '\0');
  std::memcpy(bytes.data(), &own, sizeof(own));
  std::vector<OwnUpdate> all;
  for (const std::string& of_one : collective_.all_gather(bytes)) {
    OwnUpdate& update = all.emplace_back();
    if (of_one.size() != sizeof(update))
      throw RunError(fmt::format("worker {}", collective_.members()[all.size() - 1]), "reports an update of another size");
    std::memcpy(&update, of_one.data(), sizeof(update));
  }
  return all;
}

/// By the rank with which each worker began.
void Worker::append_workers(std::vector<std::pair<std::string, double>>& values, const std::vector<OwnUpdate>& of_all) const {
  const std::vector<int> members = collective_.members();
  for (std::size_t rank = 0; rank < of_all.size(); ++rank) {
    const OwnUpdate& own = of_all[rank];
    const double stopped = own.episodes > 0 ? own.stopped / own.episodes : std::numeric_limits<double>::quiet_NaN();
    const auto add = [&](const char* name, double value) { values.emplace_back(fmt::format("workers/{}/{}", members[rank], name), value); };
    add("update_s", own.update_s);
    add("collect_s", own.collect_s);
    add("rollout_steps", own.rollout_steps);
    add("stopped", stopped);
    add("timeout", 1 - stopped);
    add("explained_variance", own.explained_variance);
    add("approx_kl", own.approx_kl);
    add("clip_fraction", own.clip_fraction);
  }
}

void Worker::report(const UpdateStats& stats, double update_s, std::uint64_t steps) {
  constexpr std::size_t num_stages = 7, first_counter = EpisodeSums::num_fields + num_stages;
  std::array<double, first_counter + RunCounters::num_fields> sums{};
  std::copy(finished_.values.begin(), finished_.values.end(), sums.begin());
  const RunCounters own = RunCounters::of(env_, *scenes_, collector_.sanitized_rows(), collector_.dropped_rows(), ratio_alarms_);
  std::copy(own.values.begin(), own.values.end(), sums.begin() + first_counter);
  const std::array<double, num_stages> stage{times_.simulate_sound, times_.convolve, times_.render, times_.move,
                                             times_.policy,         times_.learn,    times_.reduce};
  std::copy(stage.begin(), stage.end(), sums.begin() + EpisodeSums::num_fields);
  const OwnUpdate own_update{update_s,
                             std::exchange(own_step_s_, 0),
                             static_cast<double>(collector_.rollout().num_steps()),
                             finished_.values[EpisodeSums::count],
                             finished_.values[EpisodeSums::stopped],
                             stats.explained_variance,
                             stats.approx_kl,
                             stats.clip_fraction};
  const std::vector<OwnUpdate> of_all = of_all_workers(own_update);
  std::vector<RolloutTime> rollouts;
  for (const OwnUpdate& worker : of_all) rollouts.push_back({worker.collect_s, static_cast<int>(worker.rollout_steps)});
  preemption_.note_update(rollouts);
  collective_.all_reduce_sum(std::span<double>(sums));
  finished_ = {};
  times_ = {};
  RunCounters before = counters_;
  std::copy_n(sums.begin() + first_counter, counters_.values.size(), counters_.values.begin());
  if (std::exchange(lost_since_report_, false)) before = counters_;  // the totals are of the workers that are left
  EpisodeSums all;
  std::copy_n(sums.begin(), all.values.size(), all.values.begin());
  window_.push(all);  // on all ranks: any may have to write one day
  if (rank_ != 0) return;

  const double* seconds = sums.data() + EpisodeSums::num_fields;
  StageTimes mean;
  mean.add({seconds[0], seconds[1], seconds[2], seconds[3], seconds[4], seconds[5], seconds[6]}, 1.0 / world_);

  const EpisodeSums recent = window_.total();
  const double steps_per_s = static_cast<double>(steps) / update_s;
  const double left_steps = static_cast<double>(config_.total_steps) - static_cast<double>(env_steps_);
  double left_s = std::max(0.0, left_steps) / steps_per_s;
  if (config_.max_minutes > 0) left_s = std::min(left_s, std::max(0.0, config_.max_minutes * 60 - bounded_s()));
  const std::string faults = fault_summary(counters_, guards_);
  const std::string line = fmt::format(
      "update {:4}  {:>7} of {} steps  {:.0f} steps/s  success {:.3f}  SPL {:.3f}  reward {:.2f}  dtg {:.2f} m  [{}]  {:.0f} min to "
      "go{}{}\n",
      update_, env_steps_, config_.total_steps, steps_per_s, recent.mean(EpisodeSums::success), recent.mean(EpisodeSums::spl),
      recent.mean(EpisodeSums::reward), recent.mean(EpisodeSums::dtg), mean.fractions(), left_s / 60, faults.empty() ? "" : "  ! ", faults);
  std::fputs(line.c_str(), stderr);  // fmt::print would throw where the log is on a full disk

  std::vector<std::pair<std::string, double>> values = update_curves(recent, stats, mean, steps_per_s, config_.guidance, progress_);
  append_curve_values(values, counters_, before, guards_);
  append_workers(values, of_all);
  const CurvePoint point{update_, env_steps_, elapsed_s_, std::move(values)};
  write_or_go_on([&] { events_->write(point); });
  if (!config_.metrics_file.empty()) write_or_go_on([&] { write_metrics_file(config_.metrics_file, point, config_.name); });
}

void Worker::save(bool last) {
  check_equal_weights();  // else the checkpoint would be of no worker
  // Rank 0 needs the cursors of all workers; hidden states travel as raw floats.
  const torch::Tensor hidden = collector_.hidden(), not_done = collector_.not_done(), oracle_acted = collector_.oracle_acted();
  const auto raw = [](const torch::Tensor& tensor) {
    return std::string(reinterpret_cast<const char*>(tensor.data_ptr<float>()), static_cast<std::size_t>(tensor.numel()) * sizeof(float));
  };
  const auto states = collective_.all_gather(env_.save_state());
  const auto hiddens = collective_.all_gather(raw(hidden));
  const auto starts = collective_.all_gather(raw(not_done));
  const auto guided = collective_.all_gather(raw(oracle_acted));
  if (rank_ != 0) return;

  Checkpoint checkpoint;
  checkpoint.config_yaml = config_text(config_);
  checkpoint.architecture = policy_->architecture();
  checkpoint.update = update_;
  checkpoint.env_steps = env_steps_;
  checkpoint.elapsed_s = total_elapsed_s();
  checkpoint.seed = config_.seed;
  checkpoint.world_size = world_;
  checkpoint.engine = engine_hash();
  checkpoint.engine_commit = engine_commit();
  checkpoint.episode_window = window_.state();
  checkpoint.episode_window_fields = EpisodeSums::num_fields;
  checkpoint.mean_reward = window_.total().mean(EpisodeSums::reward);
  checkpoint.weights = weights_of(policy_);
  checkpoint.optimizer = optimizer_state_of(policy_, learner_.optimizer());
  checkpoint.env_states = states;
  for (const int member : collective_.members()) checkpoint.members.push_back(places_.first_of(member));
  checkpoint.started_workers = places_.started_workers;
  for (int rank = 0; rank < world_; ++rank) {
    const auto tensor_of = [](const std::string& bytes, torch::IntArrayRef shape) {
      torch::Tensor tensor = torch::empty(shape);
      if (bytes.size() != static_cast<std::size_t>(tensor.numel()) * sizeof(float))
        throw RunError("checkpoint", "workers disagree about the hidden state's size");
      std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(tensor.data_ptr<float>()));
      return tensor;
    };
    checkpoint.hidden.push_back(tensor_of(hiddens[static_cast<std::size_t>(rank)], hidden.sizes()));
    checkpoint.not_done.push_back(tensor_of(starts[static_cast<std::size_t>(rank)], not_done.sizes()));
    checkpoint.oracle_acted.push_back(tensor_of(guided[static_cast<std::size_t>(rank)], oracle_acted.sizes()));
  }
  const RunFolder folder(config_.out);
  const std::filesystem::path file = last ? folder.last_checkpoint() : folder.checkpoint_of(update_);
  // What the thread reads is its own (the tensors are copies), or rank 0's alone and not touched before finish_writing().
  const auto write_beside = [this, folder, file, last, update = update_, reward = checkpoint.mean_reward](bool whole) -> std::uint64_t {
    std::uint64_t failed = whole ? 0 : 1;
    if (whole) failed += !written([&] { checkpoints_->saved(file, update, reward, last); });
    failed += !written([&] { write_file_atomically(folder.curve(), curve_svg(config_.name, read_event_log(folder.event_log()))); });
    return failed;
  };
  finish_writing();
  last_checkpoint_ = file;
  if (last) {
    save_checkpoint(checkpoint, file);
    guards_.failed_writes += write_beside(true);
    return;
  }
  writing_ = std::async(std::launch::async, [write_beside, file, checkpoint = std::move(checkpoint)] {
    return write_beside(written([&] { save_checkpoint(checkpoint, file); }));
  });
}

bool Worker::finished() {
  // One worker's clock or signal must stop all at the same update: the sum of stop votes decides.
  const bool stops = StopSignals::received() || env_steps_ >= config_.total_steps ||
                     (rank_ == 0 && config_.max_minutes > 0 && bounded_s() >= config_.max_minutes * 60);
  std::array<double, 3> votes{stops ? 1.0 : 0.0, rank_ == 0 ? own_progress() : 0.0, collective_.has_joiners() ? 1.0 : 0.0};
  collective_.all_reduce_sum(std::span<double>(votes));
  progress_ = votes[1];
  joiners_ = votes[2] > 0;
  return votes[0] > 0;
}

void Worker::begin_files() {
  RunFolder(config_.out).remove_temporaries();
  events_.emplace(config_.out, update_);
  checkpoints_.emplace(RunFolder(config_.out), config_.keep, update_);
}

/// Of all workers in this update.  With preemption a call in which those that have their rollouts wait for the others.
std::uint64_t Worker::collected_steps() {
  if (!preemption_.is_on()) return steps_per_update();
  std::uint64_t steps = 0;
  for (const auto& text : collective_.all_gather(std::to_string(collector_.rollout().num_steps()))) steps += std::stoull(text);
  return steps * static_cast<std::uint64_t>(config_.envs_per_worker);
}

void Worker::update() {
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

TrainReport Worker::run() {
  if (rank_ == 0 && !events_) {
    begin_files();
    fmt::print(stderr, "training {}: {} workers x {} envs, {} episodes, {} parameters\n", config_.name, world_, config_.envs_per_worker,
               set_->episodes.size(), policy_->num_parameters());
  }
  const std::uint64_t first_steps = env_steps_;
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
  return {update_,          env_steps_, elapsed_s_, elapsed_s_ > 0 ? static_cast<double>(env_steps_ - first_steps) / elapsed_s_ : 0,
          last_checkpoint_, counters_,  guards_};
}

}  // namespace

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
  return Worker(config, collective, collective.is_joining() ? std::filesystem::path() : start.resume, start.changes, hooks).run();
}

}  // namespace earshot
