// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <optional>
#include <span>
#include <vector>

#include "envs/batch/agent_senses.h"
#include "envs/batch/batch_rows.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/env_run.h"
#include "envs/batch/env_state.h"
#include "envs/batch/env_workers.h"
#include "envs/batch/episode_entry.h"
#include "envs/batch/fault_desk.h"
#include "envs/hearing/engine_pool.h"

namespace earshot {

/// Next task of an env.
enum class Job : std::uint8_t {
  step,     ///< the actions, or the next episode where one has ended and Autoreset::next_step begins it
  first,    ///< the first episode of its sequence
  next,     ///< the next one
  rejoin,   ///< the next one, by a step after an abandoned task: the step must not be trained on
  begin,    ///< the episode that name_episode() has named
  restore,  ///< state of the cursor
  place,    ///< the agent to where name_place() says
};

/// The objects that all envs of a batch share.
struct EnvParts {
  const BatchSetup& setup;
  BatchRows& rows;
  FaultDesk& faults;
  AgentSenses& senses;
  EpisodeEntry& entry;
  EnginePool& engines;
};

/// Result of a task for the gathering thread.
struct TaskResults {
  std::vector<FinishedEpisode> ended;          ///< in this task, by agent
  std::vector<FinishedEpisode> failed_starts;  ///< EpisodeOrder::once: not yet among the finished
  std::vector<FinishedEpisode> given_up;       ///< EpisodeOrder::once: of the episode of a task that was given up, by agent
  std::exception_ptr error;                    ///< that ends the call
};

/// One env of a batch: its agents, the episode that they are in, and the one that follows.
///
///   env.assign(Job::step);                // by the thread that uses the batch
///   env.take_actions(actions);
///   env.run_task(workers, worker);        // by any thread: the stages of the step, the end of the episode, the start of the next
///   take(env.results());                  // by the thread that uses the batch again
///
/// Threads: one at a time.  While run_task() hangs in a task that was given up, only give_up(), cursor(true), the rows of agents() and
/// TaskResults::given_up may be used.  Steps do not allocate once buffers have grown (StepAllocation).
class Environment {
 public:
  /// parts, agents: must outlive it.  index: in the batch; it staggers which steps are timed.  helpers: threads that share the agents of
  /// this env.
  Environment(const EnvParts& parts, std::span<Agent> agents, std::size_t index, std::size_t helpers);

  void assign(Job job) { job_ = job; }
  /// Job::restore.
  void assign(const EnvCursor& cursor);
  /// The sequence of episodes that the next ones are of.
  void seed(std::uint64_t seed, std::uint32_t stream);
  /// The same for the episode of Job::begin alone: the next one is the next of the sequence that the env had.
  void borrow(std::uint64_t seed, std::uint32_t stream);
  /// The episode of Job::begin.
  void name_episode(std::uint64_t episode_index, int episode_count);
  /// The place of Job::place, at the time of the end of step `steps`.
  void name_place(const Pose& pose, int steps);
  /// The actions [agents] of a step; does nothing for another job.  Not in the task: the actions of an abandoned env are written to a file
  /// while its stage still runs.
  void take_actions(std::span<const std::int32_t> actions);
  /// Does the job and publishes its rows, unless it is given up meanwhile.  Does not throw: see TaskResults::error.
  void run_task(EnvWorkers& workers, std::size_t worker);
  /// Quarantines the episode of a task that was given up, and zeros its rows.  Reads nothing that a stage writes.
  void give_up();
  /// The task that was given up has returned: the env takes part again, and begins another episode.
  void rejoin();
  /// No episode, rows of zeros.
  void go_idle();
  /// Makes the outcomes of the agents their rows of rewards and flags.
  void publish();

  [[nodiscard]] const EnvRun& run() const { return run_; }
  [[nodiscard]] std::span<Agent> agents() { return run_.agents; }
  [[nodiscard]] std::span<const Agent> agents() const { return run_.agents; }
  [[nodiscard]] TaskResults& results() { return results_; }
  /// Where it is; given_up: a task was given up, so that its episode is void.
  [[nodiscard]] EnvCursor cursor(bool given_up) const;

 private:
  /// Episodes of an env, and the number of the last one that has begun.
  struct Sequence {
    std::uint64_t seed;
    std::uint32_t stream;
    int episode_count;
  };

  /// False: the task has been given up; its thread must leave the env alone.
  bool goes_on();
  /// body(agent, engines) for all agents, by the team where there is one.  False where body was, which no team's is.
  template <class Body>
  bool for_agents(HearingEngines* engines, const Body& body);
  void step(HearingEngines* engines);
  /// The actions of all agents, their stages, and the end of the episode.  weight: of StageClock.  Returns whether the episode has ended.
  bool step_episode(HearingEngines* engines, double weight);
  /// Of agents that end before the others.  Returns whether all have ended.
  bool end_parts();
  void begin_task(HearingEngines* engines);
  void begin_next_episode(HearingEngines* engines);
  /// Leaves a fault at an agent if the episode cannot begin.
  void begin_episode(std::uint64_t episode_index, int episode_count, HearingEngines* engines);
  void restore(HearingEngines* engines);
  void place(HearingEngines* engines);
  void end_faulty_episode();
  void end_episode();
  void clear_rows();

  EnvParts parts_;
  EnvRun run_;
  Job job_ = Job::step;
  EnvCursor cursor_;  ///< of Job::restore
  Pose place_;        ///< of Job::place
  int place_steps_ = 0;
  TaskResults results_;
  int faulty_in_a_row_ = 0;      ///< episodes that went wrong in a step, since one that did not
  std::optional<Sequence> own_;  ///< while an episode of another sequence runs: see borrow()
  std::size_t tasks_;            ///< steps, counted from the index of the env
  std::size_t num_helpers_, first_helper_;
  EnvWorkers* workers_ = nullptr;  ///< that run its task
  std::size_t worker_ = 0;
};

}  // namespace earshot
