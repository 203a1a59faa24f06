// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/preemption.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kRounding = 1e-9;  // of products like 0.6 x 5
/// A worker whose whole rollout would take so many times what the others need is slow.  Below it the order in which workers finish is
/// chance, and they are cut short by those that wait alone.
constexpr double kSlow = 1.25;

}  // namespace

Preemption::Preemption(const PpoConfig& config, int rollout_steps)
    : fraction_(config.preempt_fraction),
      rollout_steps_(rollout_steps),
      least_steps_(std::max(1, static_cast<int>(std::ceil(config.preempt_least * rollout_steps - kRounding)))) {}

int Preemption::required_workers(int world_size) const {
  return std::max(1, static_cast<int>(std::ceil(fraction_ * world_size - kRounding)));
}

bool Preemption::ends_with(int step, double elapsed_s, int num_waiting, int world_size) const {
  EARSHOT_EXPECT(may_end_with(step));
  if (num_waiting >= required_workers(world_size)) return true;
  const double step_s = elapsed_s / (step + 1);
  return step_s * rollout_steps_ > kSlow * expected_s_ && elapsed_s + step_s > expected_s_;
}

void Preemption::note_update(std::span<const RolloutTime> of_all) {
  if (!is_on()) return;
  // Those that were cut short say nothing of when the others have theirs: counted in, each update would expect less than the one before.
  std::vector<double> whole;
  for (const RolloutTime& rollout : of_all)
    if (rollout.steps == rollout_steps_) whole.push_back(rollout.collect_s);
  std::ranges::sort(whole);
  const auto enough = static_cast<std::size_t>(required_workers(static_cast<int>(of_all.size())));
  expected_s_ = whole.size() < enough ? std::numeric_limits<double>::infinity() : whole[enough - 1];
}

}  // namespace earshot
