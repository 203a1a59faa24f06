// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "trainer/held_out/held_out_config.h"

namespace earshot {

/// A mean over episodes with the 95 % interval that `earshot eval` gives it.
struct HeldOutEstimate {
  double mean = 0, low = 0, high = 0;
  friend bool operator==(const HeldOutEstimate&, const HeldOutEstimate&) = default;
};

/// What one way of acting came to.
struct HeldOutScore {
  HeldOutEstimate success, spl;
  friend bool operator==(const HeldOutScore&, const HeldOutScore&) = default;
};
/// By success, of equals by SPL.
bool is_better(const HeldOutScore& one, const HeldOutScore& other);

/// One evaluation of the weights of an update: all episodes of the set once by the likeliest actions and once by sampled ones.
struct HeldOutScores {
  HeldOutScore argmax = {}, sample = {};
  std::uint64_t env_steps = 0;  ///< of both
  double seconds = 0;           ///< wall time, of the slowest worker
};

/// Evaluations of a run so far: which update is the best one, how many in a row were no better, and their cost.  All but the seconds is a
/// function of config and seed; checkpoints hold it.
struct HeldOutState {
  std::string set = {};  ///< HeldOutEvaluator::identity(), one word: scores of another one do not compare
  std::uint64_t evaluations = 0, last_update = 0;
  std::uint64_t best_update = 0;  ///< 0: none yet
  HeldOutScore best = {};
  int since_best = 0;  ///< evaluations in a row that were not better
  std::uint64_t env_steps = 0, last_env_steps = 0;
  double seconds = 0, last_seconds = 0;
  friend bool operator==(const HeldOutState&, const HeldOutState&) = default;
};

/// The state after an evaluation of `update`.  chosen: the score of the actions that decide.
HeldOutState after_evaluation(const HeldOutState& before, std::uint64_t update, const HeldOutScores& scores, const HeldOutScore& chosen);
/// The state that a run goes on with if its evaluations are those of `set`: of another set it has the costs alone.
HeldOutState state_for_set(const HeldOutState& before, const std::string& set);

/// Whether the weights of this update are to be evaluated, as far as max_fraction allows: a multiple of every_updates has been reached
/// since the last evaluation.
bool is_due(const HeldOutConfig& config, const HeldOutState& state, std::uint64_t update);
/// Whether another evaluation that costs as much as the last one keeps `spent` within max_fraction of `spent` and `training` together; the
/// first always does.  All in environment steps or all in seconds.
bool is_within_fraction(double max_fraction, double spent, double last, double training);
/// Whether patience is at its end.
bool has_stopped_learning(const HeldOutConfig& config, const HeldOutState& state);

/// One line of text.  decode_held_out throws RunError if the text is no state.
std::string encode_held_out(const HeldOutState& state);
HeldOutState decode_held_out(const std::string& text);

}  // namespace earshot
