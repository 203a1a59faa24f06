// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "envs/batch/batch_rows.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/batched_env.h"
#include "envs/batch/env_state.h"
#include "envs/batch/env_workers.h"
#include "envs/batch/environment.h"
#include "envs/batch/fault_desk.h"
#include "envs/batch/picture_queue.h"

namespace earshot {

/// The calls of BatchedEnv that move environments: the order and threads of tasks, and the envs that are returned.  Arguments,
/// results and errors are those of the calls of BatchedEnv with the same name.
///
/// Every call submits the tasks of some envs to the workers, waits for them (send() leaves that to recv()), draws the pictures that they
/// have left, and gathers their episodes.  An env whose task was given up takes no task until that one has returned.
///
/// Used by one thread at a time.  A step allocates nothing beyond what its tasks do.
class EnvScheduler {
 public:
  /// Starts the threads.  All arguments must outlive it.
  EnvScheduler(const EnvParts& parts, PictureQueue& pictures, std::span<Environment> envs, int threads);
  EnvScheduler(const EnvScheduler&) = delete;
  EnvScheduler& operator=(const EnvScheduler&) = delete;

  void reset();
  void reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds);
  void step(std::span<const std::int32_t> actions);
  void send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions);
  void wait_ready(int min_ready, RecvOrder order);
  std::span<const std::int32_t> recv(int min_ready, RecvOrder order);
  std::optional<FaultReport> begin(int env, std::uint64_t episode_index, int episode_count, std::optional<std::uint32_t> stream);
  void place(int env, const Pose& pose, int steps);
  /// Of all envs; the cursors have been checked (batched_env.cpp).  has_started: whether any episode had begun when they were saved.
  void restore(std::span<const EnvCursor> cursors, bool has_started);
  void restore(std::size_t env, const EnvCursor& cursor);

  /// Throws std::out_of_range.
  [[nodiscard]] std::size_t index_of(int env) const;
  /// Throws std::logic_error that names the call while any env is under way.
  void refuse_while_under_way(const char* call) const;
  [[nodiscard]] bool is_under_way(std::size_t env) const { return send_state_[env] != SendState::at_rest; }
  /// Whether any episode has begun.
  [[nodiscard]] bool has_started() const { return has_started_; }
  /// Throws std::logic_error where an agent was placed: no actions lead to where it is.
  [[nodiscard]] EnvCursor cursor_of(std::size_t env) const;
  [[nodiscard]] std::span<const FinishedEpisode> finished() const { return finished_; }
  /// Sums since construction, up to the tasks that were gathered last.
  [[nodiscard]] BatchCounters counters() const;
  [[nodiscard]] const EnvWorkers& workers() const { return *workers_; }

 private:
  /// Of an env that was sent.
  enum class SendState : std::uint8_t {
    at_rest,    ///< not sent, or handed back
    under_way,  ///< sent, and its task runs
    done,       ///< and not yet handed back
  };

  /// The envs among which recv() counts.  Throws std::invalid_argument.
  [[nodiscard]] std::span<const std::uint32_t> awaited(int min_ready, RecvOrder order) const;
  [[nodiscard]] bool is_done(std::uint32_t env) const { return send_state_[env] == SendState::done; }
  void check_action(std::size_t row, std::int32_t action) const;
  /// Throws std::logic_error where the thread of a task that was given up still uses the env.
  void require_settled(std::size_t env, const char* call);
  /// Whether the env takes part.  An env with an abandoned task returns here once that task has ended.
  bool takes_part(std::size_t env);
  /// Makes the env ready for its next step and submits it.  False: it takes no part, and its flags are cleared.
  bool submit_step(std::size_t env, std::span<const std::int32_t> actions);
  /// Runs the tasks of submitted_ and gathers what came of them.
  void run_all();
  void settle(CompletedEnv completed);
  void draw_pictures(std::span<const std::uint32_t> done);
  void gather(std::span<const std::uint32_t> done);
  void gather_failed_starts(std::span<const std::uint32_t> done);
  void finish(std::vector<FinishedEpisode>& episodes);
  void clear_finished();

  EnvParts parts_;
  PictureQueue* pictures_;
  std::span<Environment> envs_;
  bool has_started_ = false;
  std::vector<std::uint32_t> all_envs_, submitted_, sent_order_;
  std::vector<std::int32_t> received_;
  std::vector<SendState> send_state_;  ///< by env
  std::vector<std::uint8_t> stalled_;  ///< by env: a task of it was given up and still runs
  std::vector<FinishedEpisode> finished_;
  std::vector<std::vector<std::int8_t>> spare_actions_;  ///< of those that were finished before
  StageSeconds stage_seconds_;
  /// Of each agent [rows], as its env was gathered: a task that was given up may still write the agent's own.
  std::vector<EffectCounters> effects_;
  std::vector<std::uint64_t> cached_responses_;
  std::optional<EnvWorkers> workers_;  ///< last: its threads use what is above
};

}  // namespace earshot
