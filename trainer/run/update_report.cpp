// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/update_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <span>
#include <thread>
#include <utility>

#include "sim/base/engine_commit.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/file_lock.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/curves/update_curves.h"

namespace earshot {
namespace {

constexpr int kMaxUpdatesWithoutStep = 20;  // in a row, before a run that learns nothing is ended
constexpr std::uint64_t kLoggedSkips = 20;  // one line each; the others are counted
// All of it is over before a launcher that ends the others kills them too.
constexpr std::chrono::milliseconds kSalvageStep(700), kLongestSalvage(2800), kSalvageLook(50);

/// A collective call.
WorkerSums sum_over_workers(const WorkerSums& worker_sums, Collective& collective) {
  constexpr std::size_t num_stages = 7, first_counter = EpisodeSums::num_fields + num_stages;
  std::array<double, first_counter + RunCounters::num_fields> sums{};
  std::ranges::copy(worker_sums.episodes.values, sums.begin());
  const StageTimes& times = worker_sums.times;
  const std::array<double, num_stages> stage{times.simulate_sound, times.convolve, times.render, times.move,
                                             times.policy,         times.learn,    times.reduce};
  std::ranges::copy(stage, sums.begin() + EpisodeSums::num_fields);
  std::ranges::copy(worker_sums.counters.values, sums.begin() + first_counter);
  collective.all_reduce_sum(std::span<double>(sums));

  WorkerSums total;
  std::copy_n(sums.begin(), total.episodes.values.size(), total.episodes.values.begin());
  const double* seconds = sums.data() + EpisodeSums::num_fields;
  total.times = {seconds[0], seconds[1], seconds[2], seconds[3], seconds[4], seconds[5], seconds[6]};
  std::copy_n(sums.begin() + first_counter, total.counters.values.size(), total.counters.values.begin());
  return total;
}

}  // namespace

UpdateReport::UpdateReport(const RunConfig& config, Collective& collective, const RunProgress& progress, RunClaim claim)
    : config_(config), collective_(collective), progress_(progress), claim_(std::move(claim)) {}

bool UpdateReport::open_files() {
  if (files_) return false;
  claim_.take();
  files_.emplace(config_, progress_.update(), DiskPatience{}, save_checkpoint,
                 config_.held_out.is_on() ? held_out_.last_update : kAllEvaluations);
  return true;
}

void UpdateReport::close_files() {
  if (!files_) return;
  guards_.failed_writes += files_->finish();
  files_.reset();
  claim_.give_up();
}

/// The statuses are those of all workers, so rank 0 can name any.
void UpdateReport::log_guards(const UpdateStats& stats) const {
  for (std::size_t i = 0; i < stats.skipped.size() && guards_.skipped_steps + i < kLoggedSkips; ++i)
    log_warning(fmt::format("update {}, epoch {}, minibatch {}: optimizer step skipped on all workers: {}{}", progress_.update(),
                            stats.skipped[i].epoch, stats.skipped[i].minibatch, describe(stats.skipped[i]),
                            guards_.skipped_steps + i + 1 == kLoggedSkips ? " (further skips are only counted)" : ""));
  if (stats.alarm_rank >= 0 && guards_.loss_alarms + guards_.kl_alarms == 0)
    log_warning(fmt::format(
        "update {}, worker {}: loss {:.4g} and KL divergence {:.4g} exceed an alarm level ({} and {}; further alarms are only counted)",
        progress_.update(), stats.alarm_rank, stats.alarm_loss, stats.alarm_kl, config_.ppo.loss_alarm, config_.ppo.kl_alarm));
}

std::optional<std::string> UpdateReport::note(UpdateStats stats) {
  const std::vector<int> members = collective_.members();  // messages name workers by the ranks with which they began
  const auto rank = static_cast<std::size_t>(collective_.identity().rank);
  for (SkippedStep& step : stats.skipped)
    for (int& faulty : step.faulty_ranks) faulty = members[static_cast<std::size_t>(faulty)];
  if (stats.alarm_rank >= 0) stats.alarm_rank = members[static_cast<std::size_t>(stats.alarm_rank)];
  if (rank == 0) log_guards(stats);
  if (stats.max_ratio_error > kMaxRatioError && ratio_alarms_++ == 0)
    log_warning(fmt::format(
        "update {}, worker {}: before the first optimizer step the learner's action probabilities differ from the rollout's by a relative "
        "{:.2g}: a mask, hidden state or observation differs from the one that the policy acted on (further updates are only counted)",
        progress_.update(), members[rank], stats.max_ratio_error));
  guards_.taken_steps += static_cast<std::uint64_t>(stats.taken_steps);
  guards_.skipped_steps += stats.skipped.size();
  guards_.loss_alarms += static_cast<std::uint64_t>(stats.loss_alarms);
  guards_.kl_alarms += static_cast<std::uint64_t>(stats.kl_alarms);
  updates_without_step_ = stats.taken_steps > 0 ? 0 : updates_without_step_ + 1;
  if (updates_without_step_ < kMaxUpdatesWithoutStep) return std::nullopt;
  return fmt::format(
      "{} updates in a row had no optimizer step, the last one because {}; resume from an earlier checkpoint with a smaller learning rate",
      updates_without_step_, stats.skipped.empty() ? "all rows were masked" : describe(stats.skipped.back()));
}

void UpdateReport::report(const UpdateStats& stats, const WorkerSums& worker_sums, const std::vector<WorkerUpdate>& worker_updates,
                          double steps_per_s) {
  const WorkerSums total = sum_over_workers(worker_sums, collective_);
  RunCounters previous_counters = std::exchange(counters_, total.counters);
  if (std::exchange(lost_since_report_, false)) previous_counters = counters_;  // the totals are of the workers that are left
  window_.push(total.episodes);                                                 // on all ranks: any may have to write one day
  const auto [rank, world_size] = collective_.identity();
  if (rank != 0) return;
  claim_.keep();

  StageTimes mean;
  mean.add(total.times, 1.0 / world_size);
  const EpisodeSums recent = window_.total();
  show_progress(recent, mean, steps_per_s);

  std::vector<std::pair<std::string, double>> values =
      update_curves(recent, stats, mean, steps_per_s, config_.guidance, progress_.fraction());
  append_curve_values(values, counters_, previous_counters, guards_);
  append_worker_values(values, collective_.members(), worker_updates);
  guards_.failed_writes +=
      files_->write_point({progress_.update(), progress_.env_steps(), progress_.position().elapsed_s, std::move(values)});
}

void UpdateReport::show_progress(const EpisodeSums& recent, const StageTimes& mean, double steps_per_s) const {
  const std::string faults = fault_summary(counters_, guards_);
  const std::string line = fmt::format(
      "update {:4}  {:>7} of {} steps  {:.0f} steps/s  success {:.3f}  SPL {:.3f}  reward {:.2f}  dtg {:.2f} m  [{}]  {:.0f} min to "
      "go{}{}\n",
      progress_.update(), progress_.env_steps(), config_.total_steps, steps_per_s, recent.mean(EpisodeSums::success),
      recent.mean(EpisodeSums::spl), recent.mean(EpisodeSums::reward), recent.mean(EpisodeSums::dtg), mean.fractions(),
      progress_.remaining_s(steps_per_s) / 60, faults.empty() ? "" : "  ! ", faults);
  std::fputs(line.c_str(), stderr);  // fmt::print would throw where the log is on a full disk
}

void UpdateReport::show_held_out(const HeldOutScores& scores) {
  if (!files_) return;
  const HeldOutState& state = held_out_;
  const double elapsed_s = progress_.total_elapsed_s();
  const auto text_of = [](const HeldOutScore& score) {
    return fmt::format("success {:.3f} [{:.3f}, {:.3f}] SPL {:.3f}", score.success.mean, score.success.low, score.success.high,
                       score.spl.mean);
  };
  const bool is_best = state.best_update == progress_.update();
  const std::string comparison =
      is_best ? "the best so far" : fmt::format("no better than update {} ({} in a row)", state.best_update, state.since_best);
  std::fputs(fmt::format("held out, update {}: argmax {}; sampled {}; {}  [{:.1f} s, {:.0f} % of the time]\n", progress_.update(),
                         text_of(scores.argmax), text_of(scores.sample), comparison, scores.seconds, 100 * state.seconds / elapsed_s)
                 .c_str(),
             stderr);
  guards_.failed_writes += files_->write_point(
      {progress_.update(), progress_.env_steps(), progress_.position().elapsed_s, held_out_curves(scores, state, elapsed_s)});
}

void UpdateReport::restore_held_out(const std::optional<HeldOutState>& saved, const std::string& set) {
  held_out_ = state_for_set(saved.value_or(HeldOutState{}), set);
}

void UpdateReport::describe_state(Checkpoint& checkpoint) const {
  checkpoint.update = progress_.update();
  checkpoint.env_steps = progress_.env_steps();
  checkpoint.elapsed_s = progress_.total_elapsed_s();
  checkpoint.world_size = collective_.identity().world_size;
  checkpoint.episode_window = window_.state();
  checkpoint.episode_window_fields = EpisodeSums::num_fields;
  checkpoint.mean_reward = window_.total().mean(EpisodeSums::reward);
  if (config_.held_out.is_on()) checkpoint.held_out = held_out_;
}

/// Fields that are equal in all checkpoints of a run.
void UpdateReport::complete(Checkpoint& checkpoint) const {
  checkpoint.config_yaml = config_text(config_);
  checkpoint.seed = config_.seed;
  checkpoint.engine = engine_hash();
  checkpoint.engine_commit = engine_commit();
}

void UpdateReport::save(Checkpoint checkpoint, bool is_last) {
  complete(checkpoint);
  last_checkpoint_ = files_->checkpoint_of(checkpoint.update, is_last);
  guards_.failed_writes += files_->save(std::move(checkpoint), is_last, [this] { collective_.note_progress(); });
}

void UpdateReport::salvage(Checkpoint whole) {
  if (whole.update == 0) return;
  complete(whole);
  const std::uint64_t update = whole.update;
  if (files_) {
    guards_.failed_writes += files_->finish();
    if (files_->saved_update() >= update) return;
    guards_.failed_writes += files_->save(std::move(whole), false);
    guards_.failed_writes += files_->finish();
    if (files_->saved_update() == update) log_info(fmt::format("update {} is saved", update));
    return;
  }
  // All have the same state.  Whoever was not lost with rank 0 writes it, the lowest first.
  const RunFolder folder(config_.out);
  const auto is_written = [&] {
    for (const auto& file : {folder.checkpoint_of(update), folder.last_checkpoint()})
      if (std::filesystem::exists(file)) try {
          if (load_checkpoint_metadata(file).update >= update) return true;
        } catch (const InputError&) {  // of a writer that was lost
        }
    return false;
  };
  const auto turn = std::chrono::steady_clock::now() + std::min(kSalvageStep * collective_.identity().rank, kLongestSalvage);
  while (std::chrono::steady_clock::now() < turn) {
    if (is_written()) return;
    std::this_thread::sleep_for(kSalvageLook);
  }
  claim_.take();
  const auto alone = FileLock::acquire(folder.checkpoint_of(update).parent_path() / "salvage.lock", kSalvageStep);
  if (is_written()) return;
  save_checkpoint(whole, folder.checkpoint_of(update));
  log_info(
      fmt::format("worker {}: update {} is saved", collective_.members()[static_cast<std::size_t>(collective_.identity().rank)], update));
}

void UpdateReport::note_members(const MembershipChange& change) {
  guards_.lost_workers += change.lost().size();
  guards_.joined_workers += change.joined().size();
}

void UpdateReport::raise_member_counts(std::uint64_t lost, std::uint64_t joined) {
  guards_.lost_workers = std::max(guards_.lost_workers, lost);
  guards_.joined_workers = std::max(guards_.joined_workers, joined);
}

void UpdateReport::go_back(const GuardCounts& guards, int updates_without_step) {
  const GuardCounts current = std::exchange(guards_, guards);
  guards_.lost_workers = current.lost_workers;
  guards_.joined_workers = current.joined_workers;
  guards_.failed_writes = current.failed_writes;
  updates_without_step_ = updates_without_step;
}

void UpdateReport::restore_window(const Checkpoint& checkpoint) {
  window_.restore(checkpoint.episode_window, checkpoint.episode_window_fields);
}

void UpdateReport::write_to(RunState& state) const {
  state.learner.episode_window = window_.state();
  state.learner.episode_window_fields = EpisodeSums::num_fields;
  if (config_.held_out.is_on()) state.learner.held_out = held_out_;
  state.guards = guards_;
  state.counters = counters_;
  state.updates_without_step = updates_without_step_;
}

void UpdateReport::set_state(const RunState& state) {
  restore_window(state.learner);
  if (state.learner.held_out) held_out_ = *state.learner.held_out;
  guards_ = state.guards;
  counters_ = state.counters;
  updates_without_step_ = state.updates_without_step;
}

}  // namespace earshot
