// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/rollout/run_counters.h"

namespace earshot {

/// State that a joining worker receives from another one: everything that is equal on all workers between two updates, and what the worker
/// that
/// writes the run has to know.  Environments, their random numbers and hidden states are not part of it.
struct RunState {
  Checkpoint learner;  ///< weights, optimizer, update, env_steps, episode_window
  GuardCounts guards;
  RunCounters counters;  ///< of all workers
  int updates_without_step = 0;
  double elapsed_s = 0, elapsed_before_s = 0;  ///< of this sitting, and of those before
  std::uint64_t steps_before = 0;              ///< env_steps with which this sitting began
};

/// Bits come back as they were.  decode_run_state throws RunError for invalid bytes.
std::string encode_run_state(const RunState& state);
RunState decode_run_state(std::string_view bytes);

/// Over the bits of weights and optimizer, as hexadecimal digits.
std::string hash_of_learner(const Checkpoint& learner);

/// Information for a worker before it joins: which part of the environments each rank of the start has (Checkpoint::members), and the
/// update
/// under way, by which its fresh environments draw other episodes than any before.
struct JoinBriefing {
  std::vector<int> places;  ///< by rank at the start
  int started_workers = 0;
  std::uint64_t update = 0;
};
std::string encode_briefing(const JoinBriefing& briefing);
/// Throws RunError for an invalid text, or one of another number of ranks.
JoinBriefing decode_briefing(const std::string& text, int world_size);

}  // namespace earshot
