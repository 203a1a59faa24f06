#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <sstream>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/net/membership.h"
#include "trainer/run/train_worker.h"

namespace earshot {

Checkpoint TrainWorker::learner_state() {
  Checkpoint learner;
  learner.architecture = policy_->architecture();
  learner.weights = weights_of(policy_);
  learner.optimizer = optimizer_state_of(policy_, learner_.optimizer());
  return learner;
}

void TrainWorker::load_learner(const Checkpoint& learner, const std::string& where) {
  load_weights(policy_, learner, where);
  load_optimizer_state(policy_, learner_.optimizer(), learner);
}

void TrainWorker::remember() {
  before_ = Before{.update = update_,
                   .env_steps = env_steps_,
                   .learner = learner_state(),
                   .guards = guards_,
                   .updates_without_step = updates_without_step_};
}

void TrainWorker::go_back() {
  load_learner(before_->learner, "the update before");
  update_ = before_->update;
  env_steps_ = before_->env_steps;
  // Members that left or came, and files that were not written, stay so.
  const GuardCounts now = guards_;
  guards_ = before_->guards;
  guards_.lost_workers = now.lost_workers;
  guards_.joined_workers = now.joined_workers;
  guards_.failed_writes = now.failed_writes;
  updates_without_step_ = before_->updates_without_step;
  collected_ = true;
}

/// The environments begin where no worker has been: by their number and the update, other episodes than those of the start or of a worker
/// that joined before.
void TrainWorker::begin_other_episodes() {
  std::vector<std::uint64_t> seeds;
  for (int env = 0; env < config_.envs_per_worker; ++env)
    seeds.push_back(
        hash64(fmt::format("joins {} {}", places_.first_of(rank_) * config_.envs_per_worker + env, briefing_.update), config_.seed));
  env_.reset(std::vector<std::uint8_t>(seeds.size(), 1), seeds);
}

std::string TrainWorker::state() {
  RunState state;
  state.learner = learner_state();
  state.learner.update = update_;
  state.learner.env_steps = env_steps_;
  state.learner.episode_window = window_.state();
  state.learner.episode_window_fields = EpisodeSums::num_fields;
  state.guards = guards_;
  state.counters = counters_;
  state.updates_without_step = updates_without_step_;
  state.elapsed_s = elapsed_s_;
  state.elapsed_before_s = elapsed_before_s_;
  state.steps_before = steps_before_;
  return encode_run_state(state);
}

void TrainWorker::take_state(const std::string& bytes) {
  const RunState state = decode_run_state(bytes);
  load_learner(state.learner, "the state of the run");
  window_.restore(state.learner.episode_window, state.learner.episode_window_fields);
  update_ = state.learner.update;
  env_steps_ = state.learner.env_steps;
  guards_ = state.guards;
  counters_ = state.counters;
  updates_without_step_ = state.updates_without_step;
  elapsed_s_ = state.elapsed_s;
  elapsed_before_s_ = state.elapsed_before_s;
  steps_before_ = state.steps_before;
}

/// Brings all to the same state: the last update that all members have completed, which workers that join get from the first of the others.
/// Members differ by one call at most, so that by one update at most.  False where a worker that joins has to leave again.
bool TrainWorker::agree_on_state() {
  constexpr const char* kJoins = "joins";
  const auto of_all =
      collective_.all_gather(joins_ ? std::string(kJoins) : fmt::format("{} {} {}", update_, guards_.lost_workers, guards_.joined_workers));
  std::vector<int> joining;
  std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  int source = -1;
  for (std::size_t place = 0; place < of_all.size(); ++place) {
    if (of_all[place] == kJoins) {
      joining.push_back(static_cast<int>(place));
      continue;
    }
    if (source < 0) source = static_cast<int>(place);
    std::uint64_t update = 0, lost = 0, joined = 0;
    if (!(std::istringstream(of_all[place]) >> update >> lost >> joined))
      throw RunError(fmt::format("worker {}", collective_.members()[place]), "does not say how far it is");
    last = std::min(last, update);
    // A change that some have not seen, as another one followed it at once.
    guards_.lost_workers = std::max(guards_.lost_workers, lost);
    guards_.joined_workers = std::max(guards_.joined_workers, joined);
  }
  if (source < 0) throw RunError("workers", "all that had the state of the run were lost; go on with --resume");
  if (!joins_ && (update_ > last || learning_)) {
    if (!before_ || before_->update != last)
      throw RunError("workers", fmt::format("are at updates {} and {}, too far from each other", last, update_));
    go_back();
  }
  learning_ = false;
  if (!joining.empty()) {
    const std::string bytes = collective_.hand_over(source, joining, rank_ == source ? state() : std::string());
    if (joins_) take_state(bytes);
  }

  const auto hashes = collective_.all_gather(hash_of_learner(learner_state()));
  const std::string& right = hashes[static_cast<std::size_t>(source)];
  bool equal = true;
  for (std::size_t place = 0; place < hashes.size(); ++place) {
    if (hashes[place] == right) continue;
    equal = false;
    if (std::ranges::find(joining, static_cast<int>(place)) == joining.end() || (joins_ && static_cast<int>(place) == rank_))
      throw RunError("workers", "hold different weights; are they the same program, config and seed, on sound memory?");
  }
  if (equal && std::exchange(joins_, false)) collective_.confirm_join();
  return equal;
}

void TrainWorker::recover(const MembershipChange& change) {
  std::vector<int> lost = change.lost(), joined = change.joined();
  const bool joins = joins_;
  const auto count = [&](const MembershipChange& one) {
    guards_.lost_workers += one.lost().size();
    guards_.joined_workers += one.joined().size();
  };
  count(change);
  while (true) try {
      rank_ = collective_.identity().rank;
      world_ = collective_.identity().world_size;
      if (rank_ != 0) leave_files();
      if (agree_on_state()) break;
      collective_.barrier();  // until the worker that holds something else has gone
    } catch (const MembershipChange& next) {
      count(next);
      lost.insert(lost.end(), next.lost().begin(), next.lost().end());
      joined.insert(joined.end(), next.joined().begin(), next.joined().end());
    }
  if (joins) joined.push_back(collective_.members()[static_cast<std::size_t>(rank_)]);
  lost_since_report_ = lost_since_report_ || !lost.empty();
  brief();
  if (rank_ != 0) return;
  if (!files_) files_.emplace(config_, update_);
  const auto named = [](const std::vector<int>& ranks) {
    return ranks.empty() ? std::string("none") : fmt::format("{}", fmt::join(ranks, ", "));
  };
  spdlog::warn("update {}: lost worker {}, joined worker {}; worker {} go on", update_, named(lost), named(joined),
               fmt::join(collective_.members(), ", "));
}

/// Of a worker that has written the run, once a lower one has joined.
void TrainWorker::leave_files() {
  if (!files_) return;
  guards_.failed_writes += files_->finish();
  files_.reset();
}

void TrainWorker::brief() {
  if (collective_.survives_loss() && !collective_.is_joining())
    collective_.brief(encode_briefing({places_.members, places_.started_workers, update_}));
}

}  // namespace earshot
