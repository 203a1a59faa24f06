#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include "sim/base/engine_commit.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "trainer/collective/worker_updates.h"
#include "trainer/curves/update_curves.h"
#include "trainer/run/train_worker.h"

namespace earshot {
namespace {

constexpr int kMaxUpdatesWithoutStep = 20;  // in a row, before a run that learns nothing is ended
constexpr std::uint64_t kLoggedSkips = 20;  // one line each; the others are counted

}  // namespace

/// Books what the guards of one update did.  The statuses are those of all workers, so rank 0 can name any.
void TrainWorker::note(UpdateStats stats) {
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

void TrainWorker::report(const UpdateStats& stats, double update_s, std::uint64_t steps) {
  constexpr std::size_t num_stages = 7, first_counter = EpisodeSums::num_fields + num_stages;
  std::array<double, first_counter + RunCounters::num_fields> sums{};
  std::copy(finished_.values.begin(), finished_.values.end(), sums.begin());
  const RunCounters own = RunCounters::of(env_, *scenes_, collector_.sanitized_rows(), collector_.dropped_rows(), ratio_alarms_);
  std::copy(own.values.begin(), own.values.end(), sums.begin() + first_counter);
  const std::array<double, num_stages> stage{times_.simulate_sound, times_.convolve, times_.render, times_.move,
                                             times_.policy,         times_.learn,    times_.reduce};
  std::copy(stage.begin(), stage.end(), sums.begin() + EpisodeSums::num_fields);
  const WorkerUpdate own_update{update_s,
                                own_step_s_,  // stays: a change of members may have this update made again from the same rollout
                                static_cast<double>(collector_.rollout().num_steps()),
                                finished_.values[EpisodeSums::count],
                                finished_.values[EpisodeSums::stopped],
                                stats.explained_variance,
                                stats.approx_kl,
                                stats.clip_fraction};
  const std::vector<WorkerUpdate> of_all = gather_worker_updates(collective_, own_update);
  std::vector<RolloutTime> rollouts;
  for (const WorkerUpdate& worker : of_all) rollouts.push_back({worker.collect_s, static_cast<int>(worker.rollout_steps)});
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
  append_worker_values(values, collective_.members(), of_all);
  const CurvePoint point{update_, env_steps_, elapsed_s_, std::move(values)};
  guards_.failed_writes += files_->write_point(point);
}

void TrainWorker::save(bool last) {
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

  Checkpoint checkpoint = learner_state();
  checkpoint.config_yaml = config_text(config_);
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
  last_checkpoint_ = files_->checkpoint_of(update_, last);
  guards_.failed_writes += files_->save(std::move(checkpoint), last);
}

}  // namespace earshot
