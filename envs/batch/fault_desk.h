// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <new>
#include <span>
#include <string>
#include <utility>

#include "envs/batch/batch_setup.h"
#include "envs/batch/env_run.h"
#include "envs/batch/quarantine.h"

namespace earshot {

/// The detail of Fault::stall.
[[nodiscard]] std::string stall_text(const EnvConfig& config);

/// Finds, notes and files the faults of episodes.  A stage calls check() or runs within guard(); a fault is noted at the agent, whose later
/// stages are then skipped, and the env quarantines the episode in the same step.
///
/// Threads: calls that name agents may run at the same time for agents of different envs, report() and check() for different agents.
/// No call allocates unless there is a fault.
class FaultDesk {
 public:
  /// setup: must outlive it.
  explicit FaultDesk(const BatchSetup& setup) : setup_(&setup), quarantine_(setup.config.quarantine_dir) {}

  /// hook: see StageHook; empty: none.  Between steps only.
  void set_hook(StageHook hook) { hook_ = std::move(hook); }
  [[nodiscard]] bool has_hook() const { return static_cast<bool>(hook_); }
  /// Calls the hook, if there is one.
  void show(const StageOutput& output, std::span<float> values) const {
    if (hook_) hook_(output, values);
  }

  /// Notes a fault of the running episode; the first one of an agent stays.
  static void report(Agent& agent, Fault fault, std::string detail);
  /// Calls the hook with `values`, then reports the fault if one is not finite.  Returns whether all are finite.
  bool check(Agent& agent, Fault kind, std::span<float> values) const;
  /// body() with every exception turned into a fault of the agent's episode.
  template <class Body>
  void guard(Agent& agent, Fault kind, const Body& body) const;

  /// Counts the episode of these agents, of one env, by its fault and writes its file.  Reads nothing that a stage writes, so that it may
  /// be called for a task that was given up.
  void quarantine(std::span<const Agent> agents, const FaultReport& fault);
  /// How a faulty episode counts among the finished: as failed, at the distance that is known.  began: whether what the agent did can be
  /// asked for.
  [[nodiscard]] FinishedEpisode failed_episode(const Agent& agent, const FaultReport& fault, bool began) const;
  [[nodiscard]] QuarantineCounters counters() const { return quarantine_.counters(); }

  void count_begun() { ++begun_; }
  void count_failed_start() { ++failed_starts_; }
  /// Throws RunError where so many stages were out of memory that no end of it is to be expected.
  void stop_if_out_of_memory() const;
  /// The same; throws InputError where none of many episodes could begin and no env has one.  active: [rows].
  void check_live_environments(std::span<const std::uint8_t> active) const;

 private:
  const BatchSetup* setup_;
  Quarantine quarantine_;
  StageHook hook_;
  std::atomic<std::uint64_t> begun_{0}, failed_starts_{0};  ///< episodes
  mutable std::atomic<std::uint64_t> out_of_memory_{0};     ///< stages
};

template <class Body>
void FaultDesk::guard(Agent& agent, Fault kind, const Body& body) const {
  try {
    body();
  } catch (const std::bad_alloc&) {
    ++out_of_memory_;
    report(agent, kind, "out of memory");
  } catch (const std::exception& error) {
    report(agent, kind, error.what());
  } catch (...) {
    report(agent, kind, "an unknown exception");
  }
}

}  // namespace earshot
