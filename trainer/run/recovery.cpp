// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/recovery.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/log.h"
#include "trainer/net/ring_config.h"

namespace earshot {
namespace {

constexpr const char* kJoins = "joins";

RunError different_weights() {
  return RunError("workers",
                  "have different weights; start all workers with the same program, config and seed, and check the memory of the hosts");
}

}  // namespace

void check_equal_weights(Collective& collective, const PolicyNetwork& policy) {
  const std::string hash = hex64(hash_of(weights_of(policy)));
  for (const auto& other : collective.all_gather(hash))
    if (other != hash) throw different_weights();
}

Recovery::Recovery(Collective& collective, const EnvPlaces& places, PolicyNetwork policy, PpoLearner& learner, RunProgress& progress,
                   UpdateReport& report)
    : collective_(collective),
      places_(places),
      policy_(std::move(policy)),
      learner_(learner),
      progress_(progress),
      report_(report),
      joins_(collective.is_joining()) {}

void Recovery::begin_update() {
  if (collective_.survives_loss())
    last_whole_update_ = WholeUpdate{.update = progress_.update(),
                                     .env_steps = progress_.env_steps(),
                                     .learner = copy_learner(),
                                     .guards = report_.guards(),
                                     .updates_without_step = report_.updates_without_step()};
  learning_ = true;
}

void Recovery::brief() {
  if (collective_.survives_loss() && !collective_.is_joining())
    collective_.brief(encode_briefing({places_.members, places_.started_workers, progress_.update()}));
}

void Recovery::recover(const MembershipChange& change) {
  std::vector<int> lost = change.lost(), joined = change.joined();
  const bool joins = joins_;
  report_.note_members(change);
  while (true) try {
      if (collective_.identity().rank != 0) report_.close_files();
      if (agree_on_state()) break;
      collective_.barrier();  // until the worker that holds something else has gone
    } catch (const MembershipChange& next) {
      report_.note_members(next);
      lost.insert(lost.end(), next.lost().begin(), next.lost().end());
      joined.insert(joined.end(), next.joined().begin(), next.joined().end());
    }
  const int rank = collective_.identity().rank;
  if (joins) joined.push_back(collective_.members()[static_cast<std::size_t>(rank)]);
  if (!lost.empty()) report_.note_loss();
  brief();
  if (rank != 0) return;
  report_.open_files();
  const auto named = [](const std::vector<int>& ranks) { return ranks.empty() ? std::string("none") : listed(ranks, ", "); };
  log_warning(fmt::format("update {}: lost worker {}, joined worker {}; worker {} continue", progress_.update(), named(lost), named(joined),
                          listed(collective_.members(), ", ")));
}

/// Members differ by one call at most, so that by one update at most.  False where a worker that joins has to leave again.
bool Recovery::agree_on_state() {
  const Standing standing = gather_standing();
  if (!joins_ && (progress_.update() > standing.last || learning_)) {
    if (!last_whole_update_ || last_whole_update_->update != standing.last)
      throw RunError("workers", fmt::format("are at updates {} and {}, which is too far apart", standing.last, progress_.update()));
    go_back();
  }
  learning_ = false;
  if (!standing.joining.empty()) {
    const bool is_source = collective_.identity().rank == standing.source;
    const std::string bytes = collective_.hand_over(standing.source, standing.joining, is_source ? encoded_state() : std::string());
    if (joins_) set_state(bytes);
  }
  const bool equal = check_equal_learners(standing);
  if (equal && std::exchange(joins_, false)) collective_.confirm_join();
  return equal;
}

Recovery::Standing Recovery::gather_standing() {
  const GuardCounts& guards = report_.guards();
  const auto of_all = collective_.all_gather(
      joins_ ? std::string(kJoins) : fmt::format("{} {} {}", progress_.update(), guards.lost_workers, guards.joined_workers));
  Standing standing;
  for (std::size_t place = 0; place < of_all.size(); ++place) {
    if (of_all[place] == kJoins) {
      standing.joining.push_back(static_cast<int>(place));
      continue;
    }
    if (standing.source < 0) standing.source = static_cast<int>(place);
    std::uint64_t update = 0, lost = 0, joined = 0;
    if (!(std::istringstream(of_all[place]) >> update >> lost >> joined))
      throw RunError(worker_name(collective_.members()[place]), "does not report its update");
    standing.last = std::min(standing.last, update);
    // A change that some have not seen, as another one followed it at once.
    report_.raise_member_counts(lost, joined);
  }
  if (standing.source < 0) throw WorldLost("workers", "all workers with the state of the run are lost; continue with --resume");
  return standing;
}

/// False where a worker that joins has another state than the source; that worker itself gets a RunError, and so do all where a worker
/// that had the state differs.
bool Recovery::check_equal_learners(const Standing& standing) {
  const int rank = collective_.identity().rank;
  const auto hashes = collective_.all_gather(hash_of_learner(copy_learner()));
  const std::string& right = hashes[static_cast<std::size_t>(standing.source)];
  bool equal = true;
  for (std::size_t place = 0; place < hashes.size(); ++place) {
    if (hashes[place] == right) continue;
    equal = false;
    const bool is_joining = std::ranges::find(standing.joining, static_cast<int>(place)) != standing.joining.end();
    if (!is_joining || (joins_ && static_cast<int>(place) == rank)) throw different_weights();
  }
  return equal;
}

void Recovery::go_back() {
  load_learner(last_whole_update_->learner, "the previous update");
  progress_.go_back(last_whole_update_->update, last_whole_update_->env_steps);
  report_.go_back(last_whole_update_->guards, last_whole_update_->updates_without_step);
}

Checkpoint Recovery::copy_learner() { return learner_state_of(policy_, learner_.optimizer()); }

void Recovery::load_learner(const Checkpoint& learner, const std::string& where) {
  load_learner_state(policy_, learner_.optimizer(), learner, where);
}

std::string Recovery::encoded_state() {
  const RunPosition& position = progress_.position();
  RunState state;
  state.learner = copy_learner();
  state.learner.update = position.update;
  state.learner.env_steps = position.env_steps;
  state.elapsed_s = position.elapsed_s;
  state.elapsed_before_s = position.elapsed_before_s;
  state.steps_before = position.steps_before;
  report_.write_to(state);
  return encode_run_state(state);
}

void Recovery::set_state(const std::string& bytes) {
  const RunState state = decode_run_state(bytes);
  load_learner(state.learner, "the state of the run");
  progress_.set_position({.update = state.learner.update,
                          .env_steps = state.learner.env_steps,
                          .steps_before = state.steps_before,
                          .elapsed_s = state.elapsed_s,
                          .elapsed_before_s = state.elapsed_before_s});
  report_.set_state(state);
}

}  // namespace earshot
