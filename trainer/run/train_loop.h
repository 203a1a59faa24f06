// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "envs/batch/quarantine.h"
#include "trainer/collective/collective.h"
#include "trainer/held_out/held_out_evaluator.h"
#include "trainer/rollout/run_counters.h"
#include "trainer/run/run_config.h"
#include "trainer/run/start_run.h"

namespace earshot {

/// Report of a finished run.
struct TrainReport {
  std::uint64_t updates = 0, env_steps = 0;
  double wall_s = 0, steps_per_s = 0;  ///< of this sitting of the run, also where this worker joined later
  std::filesystem::path checkpoint;    ///< the last one
  int signal = 0;                      ///< RunProgress::end_signal
  RunCounters counters;                ///< of all workers, since the run was started or resumed
  GuardCounts guards;
  HeldOutState held_out;  ///< of a run that evaluates itself
};

/// Hooks of tests and the evaluator of a run.
struct TrainHooks {
  StageHook stage_hook = {};             ///< of tests; see BatchedEnv::set_stage_hook
  HeldOutEvaluator* held_out = nullptr;  ///< needed where config.held_out is on; must outlive the run
};

/// One worker's part of a DD-PPO run: roll out, sum gradients, step, until config.total_steps or config.max_minutes.  Rank 0 writes
/// curves (events.jsonl, TensorBoard) and checkpoints under config.out and shows progress.  SIGTERM, SIGINT, SIGHUP and SIGUSR1 end the run
/// after the current update with a checkpoint.  start: see prepare_run; a resumed run gives the bits of the unbroken one.
///
/// A fault in one episode, one observation or one gradient is left out, counted and reported, and the run goes on
/// (docs/evidence/stability.md); so it does when a curve point or a periodic checkpoint cannot be written, and, where the collective
/// survives it, when a worker is lost: the others go back to the last update that all of them have completed, make the one under way again
/// with what they have collected, and go on; the lowest of them writes the files.  A collective that is_joining() comes to a run under way:
/// fresh environments, all else from another worker; start.resume and start.overwrite are of no matter then.  RunError: a worker dies
/// otherwise, or before the first update, weights differ between workers, the last checkpoint cannot be written, or twenty updates in a row
/// take no step; the last good checkpoint stays. Episodes that are quarantined leave their files in config.env.quarantine_dir, or else in
/// `quarantine` under config.out.
TrainReport train(const RunConfig& config, Collective& collective, const RunStart& start = {}, const TrainHooks& hooks = {});

}  // namespace earshot
