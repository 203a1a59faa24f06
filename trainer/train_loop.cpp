#include "trainer/train_loop.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include "envs/engine_commit.h"
#include "policy/torch_threads.h"
#include "sim/base/files.h"
#include "trainer/checkpoint.h"
#include "trainer/checkpoint_keeper.h"
#include "trainer/curve_svg.h"
#include "trainer/episode_window.h"
#include "trainer/event_log.h"
#include "trainer/initial_policy.h"
#include "trainer/ppo.h"
#include "trainer/result.h"
#include "trainer/rollout_collector.h"
#include "trainer/run_folder.h"
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
  Worker(const RunConfig& config, Collective& collective, const std::filesystem::path& resume, const TrainHooks& hooks)
      : config_(config),
        collective_(collective),
        rank_(collective.identity().rank),
        world_(collective.identity().world_size),
        set_(std::make_shared<const EpisodeSet>(load_episode_set(config.train.file))),
        scenes_(make_scene_cache(config.env)),
        env_(training_env(config), set_, scenes_, config.envs_per_worker, rank_ * config.envs_per_worker, world_ * config.envs_per_worker),
        policy_(config.env.observation, config.policy),
        learner_(policy_, config.ppo, config.seed, config.guidance, static_cast<double>(config.env.task.success_radius_m)),
        collector_(config, env_, policy_, rank_ * config.envs_per_worker) {
    env_.set_stage_hook(hooks.stage_hook);
    if (resume.empty()) {
      if (!config.initial_policy.empty()) load_initial_policy(config, policy_);
      env_.reset();
    } else {
      restore(resume);
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
  void restore(const std::filesystem::path& path);
  void check_equal_weights();
  UpdateStats learn();
  void note(const UpdateStats& stats);
  void report(const UpdateStats& stats, double update_s);
  void save(bool last);
  template <class Write>
  bool write_or_go_on(const Write& write);
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

  const RunConfig& config_;
  Collective& collective_;
  int rank_, world_;
  std::shared_ptr<const EpisodeSet> set_;
  std::shared_ptr<SceneCache> scenes_;
  BatchedEnv env_;
  ActorCritic policy_;
  PpoLearner learner_;
  RolloutCollector collector_;

  std::uint64_t update_ = 0, env_steps_ = 0;
  EpisodeSums finished_;
  EpisodeWindow window_;
  StageTimes times_;  ///< this update, this worker
  std::filesystem::path last_checkpoint_;
  std::optional<EventLog> events_;
  std::optional<CheckpointKeeper> checkpoints_;  ///< rank 0's
  RunCounters counters_;                         ///< of all workers
  GuardCounts guards_;
  int updates_without_step_ = 0;  ///< in a row
  std::uint64_t ratio_alarms_ = 0;
  LapTimer clock_;
  double elapsed_s_ = 0, elapsed_before_s_ = 0;  ///< in this sitting, and in those before
  double progress_ = 0;                          ///< of all workers, in [0, 1]
};

void Worker::restore(const std::filesystem::path& path) {
  const Checkpoint checkpoint = load_checkpoint(path);
  if (checkpoint.world_size != world_ || checkpoint.env_states.size() != static_cast<std::size_t>(world_))
    throw InputError(path.string(), fmt::format("is of a run with {} workers, this one has {}", checkpoint.world_size, world_),
                     "resume with the same number of workers");
  load_weights(policy_, checkpoint, path.string());
  load_optimizer_state(policy_, learner_.optimizer(), checkpoint);
  const auto rank = static_cast<std::size_t>(rank_);
  if (!torch::isfinite(checkpoint.hidden.at(rank)).all().item<bool>())
    throw InputError(path.string(), "holds a recurrent state that is not finite", "take an earlier checkpoint");
  env_.restore(checkpoint.env_states[rank]);
  collector_.restore(checkpoint.hidden.at(rank), checkpoint.not_done.at(rank),
                     checkpoint.oracle_acted.empty() ? torch::Tensor() : checkpoint.oracle_acted.at(rank));
  window_.restore(checkpoint.episode_window, checkpoint.episode_window_fields);
  update_ = checkpoint.update;
  env_steps_ = checkpoint.env_steps;
  elapsed_before_s_ = checkpoint.elapsed_s;
}

void Worker::check_equal_weights() {
  const std::string hash = hex64(hash_of(weights_of(policy_)));
  for (const auto& other : collective_.all_gather(hash))
    if (other != hash) throw RunError("workers", "hold different weights; are they the same program, config and seed, on sound memory?");
}

UpdateStats Worker::learn() {
  const UpdateStats stats = learner_.update(collector_.rollout(), progress_, update_, collective_);
  times_.learn += stats.learn_s;
  times_.reduce += stats.reduce_s;
  return stats;
}

/// Books what the guards of one update did.  The statuses are those of all workers, so rank 0 can name any.
void Worker::note(const UpdateStats& stats) {
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
        update_, rank_, stats.max_ratio_error);
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

/// A full disk must not end a run that may find room again: false, logged and counted.
template <class Write>
bool Worker::write_or_go_on(const Write& write) {
  try {
    write();
    return true;
  } catch (const std::exception& error) {
    ++guards_.failed_writes;
    spdlog::error("{}; training goes on", error.what());
    return false;
  }
}

void Worker::report(const UpdateStats& stats, double update_s) {
  constexpr std::size_t num_stages = 7, first_counter = EpisodeSums::num_fields + num_stages;
  std::array<double, first_counter + RunCounters::num_fields> sums{};
  std::copy(finished_.values.begin(), finished_.values.end(), sums.begin());
  const RunCounters own = RunCounters::of(env_, *scenes_, collector_.sanitized_rows(), collector_.dropped_rows(), ratio_alarms_);
  std::copy(own.values.begin(), own.values.end(), sums.begin() + first_counter);
  const std::array<double, num_stages> stage{times_.simulate_sound, times_.convolve, times_.render, times_.move,
                                             times_.policy,         times_.learn,    times_.reduce};
  std::copy(stage.begin(), stage.end(), sums.begin() + EpisodeSums::num_fields);
  collective_.all_reduce_sum(std::span<double>(sums));
  finished_ = {};
  times_ = {};
  const RunCounters before = counters_;
  std::copy_n(sums.begin() + first_counter, counters_.values.size(), counters_.values.begin());
  if (rank_ != 0) return;

  EpisodeSums all;
  std::copy_n(sums.begin(), all.values.size(), all.values.begin());
  window_.push(all);
  const double* seconds = sums.data() + EpisodeSums::num_fields;
  StageTimes mean;
  mean.add({seconds[0], seconds[1], seconds[2], seconds[3], seconds[4], seconds[5], seconds[6]}, 1.0 / world_);

  const EpisodeSums recent = window_.total();
  const double steps_per_s = static_cast<double>(steps_per_update()) / update_s;
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
  write_or_go_on([&] { events_->write(update_, env_steps_, elapsed_s_, std::move(values)); });
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
  const auto write = [&] {
    save_checkpoint(checkpoint, file);
    last_checkpoint_ = file;
  };
  bool written = true;
  if (last)
    write();
  else
    written = write_or_go_on(write);
  if (written) write_or_go_on([&] { checkpoints_->saved(file, update_, checkpoint.mean_reward, last); });
  write_or_go_on([&] { write_file_atomically(folder.curve(), curve_svg(config_.name, read_event_log(folder.event_log()))); });
}

bool Worker::finished() {
  // One worker's clock or signal must stop all at the same update: the sum of stop votes decides.
  const bool stops = StopSignals::received() || env_steps_ >= config_.total_steps ||
                     (rank_ == 0 && config_.max_minutes > 0 && bounded_s() >= config_.max_minutes * 60);
  std::array<double, 2> votes{stops ? 1.0 : 0.0, rank_ == 0 ? own_progress() : 0.0};
  collective_.all_reduce_sum(std::span<double>(votes));
  progress_ = votes[1];
  return votes[0] > 0;
}

TrainReport Worker::run() {
  if (rank_ == 0) {
    events_.emplace(config_.out, update_);
    checkpoints_.emplace(RunFolder(config_.out), config_.keep, update_);
    fmt::print(stderr, "training {}: {} workers x {} envs, {} episodes, {} parameters\n", config_.name, world_, config_.envs_per_worker,
               set_->episodes.size(), policy_->num_parameters());
  }
  const std::uint64_t first_steps = env_steps_;
  clock_.lap();
  while (!finished()) {
    collector_.collect(progress_, finished_, times_);
    const UpdateStats stats = learn();
    ++update_;
    env_steps_ += steps_per_update();
    const double update_s = clock_.lap();
    elapsed_s_ += update_s;
    note(stats);
    report(stats, update_s);
    if (update_ % static_cast<std::uint64_t>(config_.checkpoint_every) == 0) save(false);
  }
  save(true);
  return {update_,          env_steps_, elapsed_s_, elapsed_s_ > 0 ? static_cast<double>(env_steps_ - first_steps) / elapsed_s_ : 0,
          last_checkpoint_, counters_,  guards_};
}

}  // namespace

TrainReport train(const RunConfig& config, Collective& collective, const RunStart& start, const TrainHooks& hooks) {
  // One thread per worker: the fast setting on shared cores, and the one that gives the same bits (docs/ppo.md, section 4).
  use_one_torch_thread();
  prepare_run(config, start, collective);
  if (collective.identity().rank == 0 && !start.note.empty()) fmt::print("{}\n", start.note);
  const StopSignals signals;
  return Worker(config, collective, start.resume, hooks).run();
}

}  // namespace earshot
