// SPDX-License-Identifier: Apache-2.0
#include "trainer/held_out/held_out_state.h"

#include <fmt/format.h>

#include <cmath>
#include <sstream>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr const char* kNoSet = "-";  // what stands for an empty word

std::string text_of(const HeldOutEstimate& estimate) { return fmt::format("{} {} {}", estimate.mean, estimate.low, estimate.high); }

bool read_estimate(std::istream& text, HeldOutEstimate& estimate) {
  text >> estimate.mean >> estimate.low >> estimate.high;
  // Rounding may leave a bound of the interval a little inside of the mean.
  const auto is_fraction = [](double value) { return value >= 0 && value <= 1; };
  return text && is_fraction(estimate.mean) && is_fraction(estimate.low) && is_fraction(estimate.high);
}

bool is_duration(double seconds) { return seconds >= 0 && seconds < 1e12; }

}  // namespace

bool is_better(const HeldOutScore& one, const HeldOutScore& other) {
  if (one.success.mean != other.success.mean) return one.success.mean > other.success.mean;
  return one.spl.mean > other.spl.mean;
}

HeldOutState after_evaluation(const HeldOutState& before, std::uint64_t update, const HeldOutScores& scores, const HeldOutScore& chosen) {
  HeldOutState state = before;
  ++state.evaluations;
  state.last_update = update;
  state.env_steps += scores.env_steps;
  state.last_env_steps = scores.env_steps;
  state.seconds += scores.seconds;
  state.last_seconds = scores.seconds;
  if (state.best_update == 0 || is_better(chosen, state.best)) {
    state.best_update = update;
    state.best = chosen;
    state.since_best = 0;
  } else {
    ++state.since_best;
  }
  return state;
}

HeldOutState state_for_set(const HeldOutState& before, const std::string& set) {
  HeldOutState state = before;
  if (before.set != set) {
    state.best_update = 0;
    state.best = {};
    state.since_best = 0;
  }
  state.set = set;
  return state;
}

bool is_due(const HeldOutConfig& config, const HeldOutState& state, std::uint64_t update) {
  if (!config.is_on()) return false;
  const auto every = static_cast<std::uint64_t>(config.every_updates);
  return update / every > state.last_update / every;
}

bool is_within_fraction(double max_fraction, double spent, double last, double training) {
  return spent == 0 || spent + last <= max_fraction * (spent + last + training);
}

bool has_stopped_learning(const HeldOutConfig& config, const HeldOutState& state) {
  return config.is_on() && config.patience > 0 && state.since_best >= config.patience;
}

std::string encode_held_out(const HeldOutState& state) {
  return fmt::format("{} {} {} {} {} {} {} {} {} {} {}", state.set.empty() ? kNoSet : state.set, state.evaluations, state.last_update,
                     state.best_update, state.since_best, state.env_steps, state.last_env_steps, state.seconds, state.last_seconds,
                     text_of(state.best.success), text_of(state.best.spl));
}

HeldOutState decode_held_out(const std::string& text) {
  std::istringstream words(text);
  HeldOutState state;
  words >> state.set >> state.evaluations >> state.last_update >> state.best_update >> state.since_best >> state.env_steps >>
      state.last_env_steps >> state.seconds >> state.last_seconds;
  if (state.set == kNoSet) state.set.clear();
  const bool whole = words && read_estimate(words, state.best.success) && read_estimate(words, state.best.spl);
  const bool sound = whole && (words >> std::ws).eof() && state.best_update <= state.last_update && state.since_best >= 0 &&
                     is_duration(state.seconds) && is_duration(state.last_seconds);
  if (!sound) throw RunError("the evaluations of the run", "are not those of a run");
  return state;
}

}  // namespace earshot
