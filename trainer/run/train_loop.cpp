// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/train_loop.h"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <utility>

#include "policy/torch_threads.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/process/stop_signals.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_worker.h"

namespace earshot {
namespace {

TrainReport train_with_all(const RunConfig& config, Collective& collective, const RunStart& start, const TrainHooks& hooks) {
  // One thread per worker: the fast setting on shared cores, and the one that gives the same bits (docs/explanation/ppo.md, section 4).
  use_one_torch_thread();
  RunClaim claim(config.out, start.lock, start.lock ? start.lock->run() : "", start.lock != nullptr);
  std::filesystem::path resume;  // none for a worker that joins: it gets from the others what they have made of the checkpoint
  if (collective.is_joining()) {
    refuse_stale_episodes(config, start);
  } else {
    PreparedRun prepared = prepare_run(config, start, collective);
    claim = std::move(prepared.claim);
    resume = std::move(prepared.resume);
  }
  if (collective.identity().rank == 0 && !collective.is_joining() && !start.note.empty()) std::puts(start.note.c_str());
  if (collective.identity().rank == 0 && start.elastic && !resume.empty())
    std::puts(fmt::format("continuing from {} with {} workers", resume.string(), collective.identity().world_size).c_str());
  const StopSignals signals;
  return TrainWorker(config, collective, worker_start(collective, resume, allowed_changes(start)), resume, std::move(claim), hooks).run();
}

}  // namespace

TrainReport train(const RunConfig& config, Collective& collective, const RunStart& start, const TrainHooks& hooks) {
  try {
    return train_with_all(config, collective, start, hooks);
  } catch (const MembershipChange& change) {  // before there is anything that those who are left could go on with
    throw WorldLost("start of the run", change.what());
  }
}

}  // namespace earshot
