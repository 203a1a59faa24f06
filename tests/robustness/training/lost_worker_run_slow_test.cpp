// SPDX-License-Identifier: Apache-2.0
// Whole runs of four worker processes that go on without one of them: what it takes, what the others hold, and what is on disk.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>

#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "tests/support/workers/hooked_collective.h"
#include "tests/support/workers/training_run.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kWorld = 4;

class LostWorkerRun : public TrainingRun {
 protected:
  LostWorkerRun() : TrainingRun("checkpoint_every: 2\nkeep: 20\n", ", normalize_values: true", ", normalize_advantages: true") {}

  using Watch = std::function<void(int call)>;  ///< before or after a sum of a gradient, counted from 0
  /// This worker's part of a run of `world` workers up to so many steps.
  TrainReport run(int rank, int world, int steps, const std::string& name, const RunStart& start, const Watch& before, const Watch& after) {
    const RunConfig config = config_with({"total_steps=" + std::to_string(steps), "out=" + out(name).string(), "network.on_loss=continue"});
    RingConfig ring = ring_in(folder_, rank, world);
    ring.network = config.network;
    ring.heartbeat = std::chrono::milliseconds(150);
    const auto inner = make_zmq_ring(ring);
    int call = 0;
    HookedCollective collective(
        *inner, [&](std::span<float>) { before(call); }, [&](std::span<float>) { after(call++); });
    return train(config, collective, start);
  }
  /// The worker gets the signal in its third update; the others make six updates, and what they saved after the loss can be gone on with.
  void expect_others_go_on(int victim, int signal) {
    std::filesystem::remove_all(out());
    std::filesystem::remove_all(out("resumed"));
    const int steps = kEnvsPerWorker * kRolloutSteps * (2 * kWorld + 4 * (kWorld - 1));
    SharedArray<double, kWorld + 1> at;  // when the first sum without the victim was there; the event
    const auto start = Clock::now();
    const auto now = [&] { return std::chrono::duration<double>(Clock::now() - start).count(); };
    WorkerProcesses workers(kWorld, [&](int rank) {
      bool lost = false;
      const auto before = [&](int call) {
        if (rank != victim || call != 2 * kCallsPerUpdate + 1) return;
        at[kWorld] = now();
        ::raise(signal);
      };
      const auto after = [&](int call) {
        if (call > 2 * kCallsPerUpdate && !std::exchange(lost, call > 2 * kCallsPerUpdate)) at[static_cast<std::size_t>(rank)] = now();
      };
      try {
        const TrainReport report = run(rank, kWorld, steps, "run", {}, before, after);
        return rank != victim && report.updates == 6 && report.env_steps == static_cast<std::uint64_t>(steps) &&
               report.guards.lost_workers == 1;
      } catch (const LeftOut& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return rank == victim;
      }
    });
    for (int rank = 0; rank < kWorld; ++rank) {
      if (rank == victim) continue;
      EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank << " without " << victim;
      const double took = at[static_cast<std::size_t>(rank)] - at[kWorld];
      std::printf("worker %d: next sum %.0f ms after worker %d was gone\n", rank, 1000 * took, victim);
      EXPECT_LT(took, 8.0);  // 0.9 s at most on an idle machine
    }
    ::kill(workers.pid(victim), SIGCONT);
    const int status = workers.wait(victim);
    EXPECT_TRUE(signal == SIGKILL ? WTERMSIG(status) == SIGKILL : status == 0) << status;

    EXPECT_EQ(last_value("guards/lost_workers"), 1);
    const auto points = read_event_log(out() / "events.jsonl");
    for (std::size_t i = 1; i < points.size(); ++i) EXPECT_EQ(points[i].update, points[i - 1].update + 1);
    const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
    EXPECT_EQ(last.update, 6u);
    EXPECT_EQ(last.world_size, kWorld - 1);
    EXPECT_EQ(last.started_workers, kWorld);
    EXPECT_EQ(std::ranges::count(last.members, victim), 0);

    // Those that are left give the same bits when they are begun anew from the checkpoint of the update after the loss.
    std::filesystem::create_directories(out("resumed"));
    WorkerProcesses resumed(kWorld - 1, [&](int rank) {
      const RunStart from{.resume = out() / "checkpoints/update_000004.ckpt"};
      return run(
                 rank, kWorld - 1, steps, "resumed", from, [](int) {}, [](int) {})
                 .updates == 6;
    });
    resumed.expect_all_succeed();
    const Checkpoint again = load_checkpoint(out("resumed") / "checkpoints/last.ckpt");
    expect_same_learner(again, last);
    EXPECT_EQ(again.members, last.members);
  }
};

TEST_F(LostWorkerRun, GoesOnWithoutAKilledOne) {
  for (const int victim : {0, 2, 3}) expect_others_go_on(victim, SIGKILL);
}

TEST_F(LostWorkerRun, GoesOnWithoutAStoppedOne) { expect_others_go_on(1, SIGSTOP); }

/// Is killed when it first describes the state of the run, which it does before the first update.
class KilledBeforeTheFirstUpdate : public HookedCollective {
 public:
  explicit KilledBeforeTheFirstUpdate(Collective& inner) : HookedCollective(inner, {}, {}) {}
  void brief(const std::string&) override { ::raise(SIGKILL); }
};

// Nothing can be gone on with, and the workers that are left end so that the run is started again.
TEST_F(LostWorkerRun, ALossBeforeTheFirstUpdateIsNoFaultOfTheOthers) {
  for (int victim = 0; victim < kWorld; ++victim) {
    WorkerProcesses workers(kWorld, [&](int rank) {
      const RunConfig config = config_with({"out=" + out(std::to_string(victim)).string(), "network.on_loss=continue"});
      RingConfig ring = ring_in(folder_, rank, kWorld);
      ring.network = config.network;
      const auto inner = make_zmq_ring(ring);
      try {
        KilledBeforeTheFirstUpdate killed(*inner);
        train(config, rank == victim ? killed : *inner, {});
      } catch (const WorldLost& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return rank != victim;
      } catch (const LeftOut& error) {  // the others had ended before it heard of the loss
        std::fprintf(stderr, "%s\n", error.what());
        return rank != victim;
      }
      return false;
    });
    for (int rank = 0; rank < kWorld; ++rank) {
      if (rank == victim) continue;
      EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank << " without " << victim;
    }
    EXPECT_EQ(WTERMSIG(workers.wait(victim)), SIGKILL);
  }
}

// Another number of workers is declared: weights, optimizer and schedule go on, environments in their order.
TEST_F(LostWorkerRun, ResumesWithAnotherNumberOfWorkers) {
  const int per_worker = kEnvsPerWorker * kRolloutSteps;
  const auto nothing = [](int) {};
  WorkerProcesses first(2, [&](int rank) { return run(rank, 2, 2 * 2 * per_worker, "run", {}, nothing, nothing).updates == 2; });
  first.expect_all_succeed();
  const std::filesystem::path checkpoint = out() / "checkpoints/last.ckpt";
  WorkerProcesses refused(3, [&](int rank) {
    try {
      run(rank, 3, 10 * per_worker, "three", {.resume = checkpoint}, nothing, nothing);
    } catch (const std::exception& error) {
      return std::string(error.what()).find("worker") != std::string::npos;
    }
    return false;
  });
  refused.expect_all_succeed();
  WorkerProcesses more(3, [&](int rank) {
    const TrainReport report = run(rank, 3, 10 * per_worker, "three", {.resume = checkpoint, .changes = {"workers"}}, nothing, nothing);
    return report.updates == 4 && report.env_steps == 10u * per_worker;
  });
  more.expect_all_succeed();
  const Checkpoint before = load_checkpoint(checkpoint), after = load_checkpoint(out("three") / "checkpoints/last.ckpt");
  EXPECT_EQ(after.world_size, 3);
  EXPECT_EQ(after.env_states.size(), 3u);
  EXPECT_FALSE(torch::equal(before.weights.begin()->second, after.weights.begin()->second));
  for (const auto& [name, tensor] : before.optimizer)
    if (name.ends_with(".step")) {
      EXPECT_EQ(after.optimizer.at(name).item<double>(), tensor.item<double>() + 2 * kCallsPerUpdate) << name;
    }
}

}  // namespace
}  // namespace earshot
