// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

namespace earshot {

/// An environment whose task has ended, or has been given up.
struct CompletedEnv {
  std::uint32_t env = 0;
  bool stalled = false;  ///< its task exceeded the limit; it still runs, and has_returned() says when it no longer does
};

/// Threads that run one task per environment and hand environments back in the order in which they are done.  Submitting, taking and
/// handing back are loads and stores of atomics; threads that find nothing to do sleep in the kernel.  Used by one thread at a time.
class EnvWorkers {
 public:
  /// Task for one environment.  worker: of the thread that runs it, in [0, num_workers()); never two at a time with the same
  /// number.  Must not throw.
  using Task = std::function<void(std::size_t env, std::size_t worker)>;

  /// threads: at least 1.  stage_limit_s: a task that calls beat() less often is given up: its thread is replaced, and others of the batch
  /// go on.  0: none is given up, and the thread that waits runs tasks too, as one of `threads`.
  EnvWorkers(int threads, std::size_t num_envs, double stage_limit_s, Task task);
  /// Waits for running tasks, except for abandoned ones (tasks_given_up()); the data that those use must stay alive.
  ~EnvWorkers();
  EnvWorkers(const EnvWorkers&) = delete;
  EnvWorkers& operator=(const EnvWorkers&) = delete;

  /// Starts the task for these environments; none of them may be under way.
  void submit(std::span<const std::uint32_t> envs);
  /// The next environment that is done; waits for it.  One must be under way.  Throws RunError where so many tasks are given up that no
  /// thread is left.
  CompletedEnv next();
  /// A finished one; nullopt if all are still running.
  std::optional<CompletedEnv> done_already();
  /// next() for every environment that is under way.  done: called for each, in any order.
  template <class Done>
  void finish(const Done& done) {
    while (num_under_way() > 0) done(next());
  }
  /// With separate threads: between submit() and next() the calling thread does other work.
  void run_in_background();

  [[nodiscard]] std::size_t num_under_way() const;
  /// Whether any task runs or waits to run, those that were given up included.  From any thread, without a lock.
  [[nodiscard]] bool is_busy() const;
  /// Upper bound of worker numbers, replacements of stalled ones included.
  [[nodiscard]] std::size_t num_workers() const;
  /// Called by a task when it begins another stage.  False: it has been given up, and must return without touching what belongs to its
  /// environment's results.
  [[nodiscard]] bool beat(std::size_t worker);
  /// Whether the task of an environment that stalled has returned meanwhile.  Says so once.
  bool has_returned(std::size_t env);
  /// Tasks that were given up and have not returned.
  [[nodiscard]] std::size_t tasks_given_up() const;

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  ///< with threads that were given up
};

}  // namespace earshot
