#include "trainer/run/train_loop.h"

#include <fmt/format.h>

#include "policy/torch_threads.h"
#include "sim/base/process/stop_signals.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_worker.h"

namespace earshot {

TrainReport train(const RunConfig& config, Collective& collective, const RunStart& start, const TrainHooks& hooks) {
  // One thread per worker: the fast setting on shared cores, and the one that gives the same bits (docs/explanation/ppo.md, section 4).
  use_one_torch_thread();
  if (collective.is_joining())
    refuse_stale_episodes(config, start);
  else
    prepare_run(config, start, collective);
  if (collective.identity().rank == 0 && !collective.is_joining() && !start.note.empty()) fmt::print("{}\n", start.note);
  const StopSignals signals;
  // A worker that joins gets from the others what they have made of the checkpoint.
  const std::filesystem::path resume = collective.is_joining() ? std::filesystem::path() : start.resume;
  return TrainWorker(config, collective, worker_start(collective, resume, start.changes), resume, hooks).run();
}

}  // namespace earshot
