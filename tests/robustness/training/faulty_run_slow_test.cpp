// SPDX-License-Identifier: Apache-2.0
// Whole runs of three worker processes: env, policy, learner, collective, files.  Faults come in where the product has seams for tests: the
// hook of the environment, and a collective that damages what passes.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <fstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/workers/fault_bench.h"
#include "tests/support/workers/training_run.h"
#include "trainer/run/train_loop.h"

namespace earshot::faults {
namespace {

class FaultyRun : public TrainingRun {
 protected:
  FaultyRun() : TrainingRun("workers: 3\ncheckpoint_every: 2\n") {}

  struct Faults {
    std::function<void(int rank, const StageOutput&, std::span<float>)> env;
    std::function<void(int rank, int call, std::span<float>)> before, after;
  };
  /// This worker's part of a run of `updates` updates.
  TrainReport run(int rank, int updates, const Faults& faults, const std::filesystem::path& resume = {}) {
    const RunConfig config = config_with({"total_steps=" + std::to_string(updates * kWorkers * kEnvsPerWorker * kRolloutSteps)});
    const auto ring = make_zmq_ring(ring_in(folder_, rank, kWorkers));
    int call = 0;
    const auto damage = [&](const auto& event, std::span<float> gradient) {
      if (event) event(rank, call, gradient);
    };
    HookedCollective collective(
        *ring, [&](std::span<float> gradient) { damage(faults.before, gradient); },
        [&](std::span<float> sum) {
          damage(faults.after, sum);
          ++call;
        });
    TrainHooks hooks;
    if (faults.env) hooks.stage_hook = [&, rank](const StageOutput& output, std::span<float> values) { faults.env(rank, output, values); };
    return train(config, collective, {.resume = resume}, hooks);
  }
};

// A NaN from the ear of one env of each worker, and a gradient message damaged at each worker: counted, named, left out; the run ends well,
// and its weights can be resumed from.
TEST_F(FaultyRun, GoesOnToItsEnd) {
  Faults faults;
  SharedArray<std::atomic<int>, kWorkers> poisoned;
  faults.env = [&](int rank, const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::sound && output.env == rank * kEnvsPerWorker && output.step == 3 &&
        poisoned[static_cast<std::size_t>(rank)].exchange(1) == 0)
      values[0] = kNan;
  };
  faults.after = [](int rank, int call, std::span<float> buffer) {
    if (call == 4 + rank) buffer[7] = kInfinity;
  };
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const TrainReport report = run(rank, 4, faults);
    return report.updates == 4 && report.guards.skipped_steps == kWorkers && report.guards.taken_steps == 4 * 4 - kWorkers &&
           report.counters[RunCounters::quarantined] == kWorkers && report.counters[RunCounters::not_finite] == kWorkers &&
           report.counters[RunCounters::sanitized_rows] == 0 && report.counters[RunCounters::poses] > 0;
  });
  workers.expect_all_succeed();
  for (std::size_t rank = 0; rank < kWorkers; ++rank) EXPECT_EQ(poisoned[rank], 1);
  EXPECT_EQ(last_value("guards/quarantined"), kWorkers);
  EXPECT_EQ(last_value("guards/skipped_steps"), kWorkers);
  EXPECT_EQ(last_value("guards/sanitized_rows"), 0);
  EXPECT_EQ(last_value("guards/ratio_alarms"), 0);
  EXPECT_GE(last_value("hearing/cached"), 0);
  // Each quarantined episode left its file.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(out() / "quarantine"), {}), kWorkers);

  WorkerProcesses resumed(kWorkers, [&](int rank) {
    const TrainReport report = run(rank, 6, {}, out() / "checkpoints/last.ckpt");
    return report.updates == 6 && report.guards.skipped_steps == 0 && report.guards.taken_steps == 8;
  });
  resumed.expect_all_succeed();
}

// Weights of which every step fails teach nothing: the run says so and ends, and its last checkpoint is of the last good weights.
TEST_F(FaultyRun, ThatTakesNoStepIsEnded) {
  Faults faults;
  faults.before = [](int rank, int, std::span<float> buffer) {
    if (rank == kMiddle) buffer[0] = kNan;
  };
  SharedArray<std::atomic<int>, 1> reasons;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    try {
      run(rank, 100, faults);
    } catch (const RunError& error) {
      // Whoever says so first stops the others, which may still be on their way to say the same.
      const std::string message = error.what();
      const bool is_own_error = message.find("20 updates in a row had no optimizer step") != std::string::npos;
      reasons[0] += is_own_error;
      return is_own_error || message.find("stopped the run") != std::string::npos;
    }
    return false;
  });
  workers.expect_all_succeed();
  EXPECT_GE(reasons[0], 1);
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/last.ckpt").update, 20u);
}

// Killed while all train: the others end with its name within seconds, and the run goes on from the last checkpoint to the bits of the
// unbroken one.
TEST_F(FaultyRun, KilledWorkerIsNamedAndTheRunResumes) {
  for (const int victim : {kFirst, kMiddle, kLast}) {
    std::filesystem::remove_all(out());
    WorkerProcesses unbroken(kWorkers, [&](int rank) { return run(rank, 6, {}).updates == 6; });
    unbroken.expect_all_succeed();
    const Checkpoint expected = load_checkpoint(out() / "checkpoints/last.ckpt");
    std::filesystem::remove_all(out());

    Faults faults;
    faults.before = [&](int rank, int call, std::span<float>) {
      if (rank == victim && call == 4 * 4 + 1) ::raise(SIGKILL);  // in the fifth update; checkpoints are of the second and fourth
    };
    WorkerProcesses workers(kWorkers, [&](int rank) {
      try {
        run(rank, 6, faults);
      } catch (const RunError& error) {
        return std::string(error.what()).find("worker " + std::to_string(victim)) != std::string::npos;
      }
      return false;
    });
    for (int rank = 0; rank < kWorkers; ++rank) {
      const int status = workers.wait(rank);
      if (rank == victim) {
        EXPECT_EQ(WTERMSIG(status), SIGKILL);
      } else {
        EXPECT_EQ(status, 0) << "worker " << rank << " of the others";
      }
    }
    const std::filesystem::path checkpoint = find_checkpoint(out());
    EXPECT_EQ(checkpoint.filename(), "update_000004.ckpt");
    WorkerProcesses resumed(kWorkers, [&](int rank) { return run(rank, 6, {}, checkpoint).updates == 6; });
    resumed.expect_all_succeed();
    // All but the minutes that it took.
    const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
    for (const auto& [name, tensor] : expected.weights) EXPECT_TRUE(torch::equal(tensor, last.weights.at(name))) << name;
    for (const auto& [name, tensor] : expected.optimizer) EXPECT_TRUE(torch::equal(tensor, last.optimizer.at(name))) << name;
    for (std::size_t rank = 0; rank < kWorkers; ++rank) EXPECT_TRUE(torch::equal(expected.hidden.at(rank), last.hidden.at(rank))) << rank;
    EXPECT_EQ(last.env_states, expected.env_states);
    EXPECT_EQ(last.episode_window, expected.episode_window);
  }
}

// The disk is full for a while: periodic checkpoints and curve points fail and are counted, training goes on, and once there is room the
// last checkpoint is written.  The limit on the size of any file stands for the disk.
TEST_F(FaultyRun, GoesOnWithAFullDisk) {
  WorkerProcesses workers(kWorkers, [&](int rank) {
    ::signal(SIGXFSZ, SIG_IGN);
    const auto limit_files = [](rlim_t bytes) {
      const rlimit limit{bytes, RLIM_INFINITY};
      ::setrlimit(RLIMIT_FSIZE, &limit);
    };
    Faults faults;
    faults.before = [&](int, int call, std::span<float>) {
      if (call == 2) limit_files(1);  // in the first update: curve point, checkpoint and picture of it and of the second do not fit
      if (call == 4 * 3 - 1) limit_files(RLIM_INFINITY);  // there is room again in the third
    };
    const TrainReport report = run(rank, 4, faults);
    return report.updates == 4 && report.guards.failed_writes == (rank == 0 ? 6u : 0u);
  });
  workers.expect_all_succeed();
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/last.ckpt").update, 4u);
  EXPECT_FALSE(std::filesystem::exists(out() / "checkpoints/update_000002.ckpt"));
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/update_000003.ckpt").update, 3u) << "what was owed";
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/update_000004.ckpt").update, 4u);
  EXPECT_EQ(read_event_log(out() / "events.jsonl").size(), 2u);  // of updates 3 and 4
}

}  // namespace
}  // namespace earshot::faults
