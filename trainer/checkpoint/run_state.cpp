// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <msgpack.hpp>
#include <span>
#include <sstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/listed.h"
#include "trainer/checkpoint/checkpoint_format.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

/// `learner` is the body of a checkpoint file, with its hash.
struct StateMessage {
  static constexpr std::size_t kFields = 14;
  std::uint16_t version = kWireVersion;
  std::string learner;
  std::vector<double> counters;
  std::uint64_t taken_steps = 0, skipped_steps = 0, loss_alarms = 0, kl_alarms = 0, lost_workers = 0, joined_workers = 0, failed_writes = 0;
  std::int32_t updates_without_step = 0;
  double elapsed_s = 0, elapsed_before_s = 0;
  std::uint64_t steps_before = 0;
  MSGPACK_DEFINE(version, learner, counters, taken_steps, skipped_steps, loss_alarms, kl_alarms, lost_workers, joined_workers,
                 failed_writes, updates_without_step, elapsed_s, elapsed_before_s, steps_before)
};

}  // namespace

std::string encode_run_state(const RunState& state) {
  StateMessage message;
  message.learner = encode_checkpoint(state.learner, "the state of the run");
  message.counters.assign(state.counters.values.begin(), state.counters.values.end());
  message.taken_steps = state.guards.taken_steps;
  message.skipped_steps = state.guards.skipped_steps;
  message.loss_alarms = state.guards.loss_alarms;
  message.kl_alarms = state.guards.kl_alarms;
  message.lost_workers = state.guards.lost_workers;
  message.joined_workers = state.guards.joined_workers;
  message.failed_writes = state.guards.failed_writes;
  message.updates_without_step = state.updates_without_step;
  message.elapsed_s = state.elapsed_s;
  message.elapsed_before_s = state.elapsed_before_s;
  message.steps_before = state.steps_before;
  return encode(message);
}

RunState decode_run_state(std::string_view bytes) {
  constexpr const char* where = "the state of the run";
  RunState state;
  try {
    const auto message = decode<StateMessage>(bytes, kMaxCheckpointBytes);
    if (message.counters.size() != state.counters.values.size()) throw WireError("wrong number of counters");
    state.learner = decode_checkpoint(message.learner, where);
    std::ranges::copy(message.counters, state.counters.values.begin());
    state.guards = {.taken_steps = message.taken_steps,
                    .skipped_steps = message.skipped_steps,
                    .loss_alarms = message.loss_alarms,
                    .kl_alarms = message.kl_alarms,
                    .failed_writes = message.failed_writes,
                    .lost_workers = message.lost_workers,
                    .joined_workers = message.joined_workers};
    state.updates_without_step = message.updates_without_step;
    state.elapsed_s = message.elapsed_s;
    state.elapsed_before_s = message.elapsed_before_s;
    state.steps_before = message.steps_before;
  } catch (const WireError& error) {
    throw RunError(where, error.what());
  } catch (const InputError& error) {
    throw RunError(where, error.what());
  }
  return state;
}

std::string hash_of_learner(const Checkpoint& learner) {
  std::uint64_t hash = hash_of(learner.weights);
  for (const auto& [name, tensor] : learner.optimizer) {
    const torch::Tensor flat = tensor.contiguous();
    hash = hash64(name, hash);
    hash = hash64(std::span(static_cast<const std::byte*>(flat.data_ptr()), flat.nbytes()), hash);
  }
  return hex64(hash);
}

std::string encode_briefing(const JoinBriefing& briefing) {
  return fmt::format("{} {} {}", briefing.update, briefing.started_workers, listed(briefing.places, " "));
}

JoinBriefing decode_briefing(const std::string& text, int world_size) {
  JoinBriefing briefing;
  std::istringstream stream(text);
  stream >> briefing.update >> briefing.started_workers;
  for (int place = 0; stream >> place;) briefing.places.push_back(place);
  bool sound = stream.eof() && briefing.places.size() == static_cast<std::size_t>(world_size) && briefing.started_workers <= 64;
  for (const int place : briefing.places) sound = sound && place >= 0 && place < briefing.started_workers;
  if (!sound) throw RunError("the run", "does not contain the assignment of environments to workers");
  return briefing;
}

}  // namespace earshot
