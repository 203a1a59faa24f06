// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_progress.h"

#include <algorithm>
#include <array>
#include <csignal>
#include <span>

#include "sim/base/process/stop_signals.h"

namespace earshot {

RunProgress::RunProgress(const RunConfig& config) : config_(config) {}

void RunProgress::go_back(std::uint64_t update, std::uint64_t env_steps) {
  position_.update = update;
  position_.env_steps = env_steps;
  has_rollout_ = true;
}

bool RunProgress::agree_on_end(Collective& collective, HeldOutVote vote) {
  // One worker's clock or signal must stop all at the same update: the sum of stop votes decides.
  const bool is_first = collective.identity().rank == 0;
  const bool is_out_of_time = is_first && config_.max_minutes > 0 && bounded_s() >= config_.max_minutes * 60;
  const bool is_done = position_.env_steps >= config_.total_steps || is_out_of_time || (is_first && vote.has_stopped);
  const bool evaluates = is_first && vote.evaluates && !is_out_of_time;
  const int signal = StopSignals::signal();
  std::array<double, 6> votes{is_done ? 1.0 : 0.0,
                              is_first ? own_fraction() : 0.0,
                              collective.has_joiners() ? 1.0 : 0.0,
                              signal == SIGINT ? 1.0 : 0.0,
                              signal != 0 && signal != SIGINT ? 1.0 : 0.0,
                              evaluates ? 1.0 : 0.0};
  collective.all_reduce_sum(std::span<double>(votes));
  fraction_ = votes[1];
  has_joiners_ = votes[2] > 0;
  evaluates_ = votes[5] > 0 && votes[3] + votes[4] == 0;
  end_signal_ = votes[0] > 0 ? 0 : votes[4] > 0 ? SIGTERM : votes[3] > 0 ? SIGINT : 0;
  return !evaluates_ && (votes[0] > 0 || end_signal_ != 0);
}

double RunProgress::complete_update(std::uint64_t steps) {
  has_rollout_ = false;
  ++position_.update;
  position_.env_steps += steps;
  const double update_s = clock_.lap();
  position_.elapsed_s += update_s;
  return update_s;
}

double RunProgress::steps_per_s() const {
  return position_.elapsed_s > 0 ? static_cast<double>(position_.env_steps - position_.steps_before) / position_.elapsed_s : 0;
}

double RunProgress::remaining_s(double steps_per_s) const {
  const double left_steps = static_cast<double>(config_.total_steps) - static_cast<double>(position_.env_steps);
  const double left_s = std::max(0.0, left_steps) / steps_per_s;
  return config_.max_minutes > 0 ? std::min(left_s, std::max(0.0, config_.max_minutes * 60 - bounded_s())) : left_s;
}

double RunProgress::own_fraction() const {
  const double by_steps = static_cast<double>(position_.env_steps) / static_cast<double>(config_.total_steps);
  const double by_time = config_.schedule == Schedule::minutes ? total_elapsed_s() / (60 * config_.max_minutes) : 0;
  return std::min(1.0, std::max(by_steps, by_time));
}

double RunProgress::bounded_s() const { return config_.schedule == Schedule::minutes ? total_elapsed_s() : position_.elapsed_s; }

}  // namespace earshot
