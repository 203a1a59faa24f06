// SPDX-License-Identifier: Apache-2.0
// Whole runs of four worker processes in which a lost one comes back: what it gets, what it brings, what is on disk, and who may not come.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <map>
#include <memory>
#include <thread>

#include "evaluation/results/result.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/hooked_collective.h"
#include "tests/support/workers/training_run.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

constexpr int kWorld = 4;

struct Shared {
  std::atomic<int> sums[kWorld];   ///< of each rank, since its process began
  std::atomic<int> world[kWorld];  ///< in the last of them
};

class JoinRun : public TrainingRun {
 protected:
  JoinRun()
      : TrainingRun("checkpoint_every: 1\nkeep: 100\ntotal_steps: 100000\n", ", normalize_values: true",
                    ", normalize_advantages: true, target_kl: 0.5") {}
  Shared& shared() { return shared_[0]; }

  struct Start {
    bool joins = false;
    std::vector<std::string> overrides = {};
    RunStart run = {};
    std::string engine = engine_hash();
  };
  /// watch: called after each sum of a gradient, with their number.
  TrainReport run(int rank, const Start& start, const std::function<void(int sums)>& watch = {}) {
    std::vector<std::string> overrides{"network.on_loss=continue", "metrics_file=" + (folder_.path() / "metrics.prom").string()};
    overrides.insert(overrides.end(), start.overrides.begin(), start.overrides.end());
    const RunConfig config = config_with(overrides);
    RingConfig ring = ring_in(folder_, rank, kWorld);
    ring.network = config.network;
    ring.heartbeat = std::chrono::milliseconds(150);
    ring.engine = start.engine;
    ring.settings = common_settings(config);
    const auto inner = start.joins ? make_joining_worker(ring) : make_zmq_ring(ring);
    int sums = 0;
    HookedCollective collective(*inner, {}, [&](std::span<float>) {
      shared().sums[rank] = ++sums;
      shared().world[rank] = inner->identity().world_size;
      if (watch) watch(sums);
    });
    return train(config, collective, start.run);
  }
  void wait_for(const std::function<bool()>& condition) { EXPECT_TRUE(wait_until(condition, 60)); }
  void wait_for_updates(const std::vector<int>& ranks, int world, int updates) {
    for (const int rank : ranks) wait_for([&] { return shared().world[rank] == world; });
    for (const int rank : ranks) {
      const int from = shared().sums[rank];
      wait_for([&] { return shared().sums[rank] >= from + updates * kCallsPerUpdate; });
    }
  }
  static std::map<std::string, double> values_of(const CurvePoint& point) { return {point.values.begin(), point.values.end()}; }

  SharedArray<Shared, 1> shared_;
};

// Killed in its third update, started again two updates later.  What was saved with all four back gives the bits of the run when four
// workers go on from it: the state that was handed over and the fresh environments are whole.
TEST_F(JoinRun, ALostWorkerComesBack) {
  for (const int victim : {0, 2}) {
    std::filesystem::remove_all(out());
    for (int rank = 0; rank < kWorld; ++rank) shared().sums[rank] = shared().world[rank] = 0;
    WorkerProcesses workers(kWorld, [&](int rank) {
      const TrainReport report = run(rank, {}, [&](int sums) {
        if (rank == victim && sums == 2 * kCallsPerUpdate + 2) ::raise(SIGKILL);
      });
      return report.guards.lost_workers == 1 && report.guards.joined_workers == 1;
    });
    EXPECT_EQ(WTERMSIG(workers.wait(victim)), SIGKILL);
    std::vector<int> left;
    for (int rank = 0; rank < kWorld; ++rank)
      if (rank != victim) left.push_back(rank);
    wait_for_updates(left, kWorld - 1, 2);
    shared().sums[victim] = shared().world[victim] = 0;
    WorkerProcesses back(1, [&](int) {
      const TrainReport report = run(victim, {.joins = true});
      return report.guards.lost_workers == 1 && report.guards.joined_workers == 1;
    });
    wait_for_updates({0, 1, 2, 3}, kWorld, 4);
    ::kill(workers.pid(left.back()), SIGTERM);  // all end after this update, with a checkpoint
    for (const int rank : left) EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank << " with " << victim << " back";
    EXPECT_EQ(back.wait(0), 0) << victim;

    // Curves: the workers of each update, and the steps that they made.
    const auto points = read_event_log(out() / "events.jsonl");
    std::uint64_t steps = 0, joined_at = 0;
    bool was_away = false;
    const std::string own_curve = "workers/" + std::to_string(victim) + "/rollout_steps";
    for (std::size_t i = 0; i < points.size(); ++i) {
      auto values = values_of(points[i]);
      if (i > 0) {
        EXPECT_EQ(points[i].update, points[i - 1].update + 1);
      }
      int present = 0;
      for (int rank = 0; rank < kWorld; ++rank) present += values.contains("workers/" + std::to_string(rank) + "/rollout_steps");
      const std::uint64_t made = points[i].env_steps - steps;
      EXPECT_EQ(made, static_cast<std::uint64_t>(present * kEnvsPerWorker * kRolloutSteps)) << points[i].update;
      steps = points[i].env_steps;
      EXPECT_EQ(present, values.contains(own_curve) ? kWorld : kWorld - 1);
      was_away = was_away || !values.contains(own_curve);
      if (was_away && values.contains(own_curve) && joined_at == 0) joined_at = points[i].update;
      EXPECT_EQ(values.at("guards/joined_workers"), joined_at > 0 ? 1 : 0) << points[i].update;
      EXPECT_EQ(values.at("guards/lost_workers"), was_away ? 1 : 0) << points[i].update;
    }
    ASSERT_GT(joined_at, 0u);
    const std::string metrics = read_file(folder_.path() / "metrics.prom");
    EXPECT_NE(metrics.find("earshot_workers_rollout_steps{run=\"tiny\",worker=\"" + std::to_string(victim) + "\"} 8"), std::string::npos);
    EXPECT_NE(metrics.find("earshot_guards_joined_workers_total{run=\"tiny\"} 1"), std::string::npos);

    // Checkpoints: of whom, and that they can be gone on with.
    const auto checkpoint_of = [&](std::uint64_t update) {
      return out() / "checkpoints" / ("update_" + std::string(6 - std::to_string(update).size(), '0') + std::to_string(update) + ".ckpt");
    };
    const Checkpoint away = load_checkpoint(checkpoint_of(joined_at - 1)), whole = load_checkpoint(checkpoint_of(joined_at));
    EXPECT_EQ(away.world_size, kWorld - 1);
    EXPECT_EQ(std::ranges::count(away.members, victim), 0);
    EXPECT_EQ(whole.world_size, kWorld);
    EXPECT_EQ(whole.members, (std::vector<int>{0, 1, 2, 3}));
    EXPECT_EQ(whole.started_workers, kWorld);
    // Other episodes than those with which it began: a new run's first checkpoint is of the same length of rollouts.
    EXPECT_NE(whole.env_states[static_cast<std::size_t>(victim)],
              load_checkpoint(checkpoint_of(1)).env_states[static_cast<std::size_t>(victim)]);
    std::filesystem::remove_all(out("resumed"));
    std::filesystem::create_directories(out("resumed"));
    const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
    WorkerProcesses resumed(kWorld, [&](int rank) {
      return run(rank, {.overrides = {"out=" + out("resumed").string(), "total_steps=" + std::to_string(last.env_steps)},
                        .run = {.resume = checkpoint_of(joined_at)}})
                 .updates == last.update;
    });
    resumed.expect_all_succeed();
    const Checkpoint again = load_checkpoint(out("resumed") / "checkpoints/last.ckpt");
    expect_same_learner(last, again);
    EXPECT_EQ(last.episode_window, again.episode_window);
  }
}

// Who has another config or engine is refused; who dies before it has the state of the run, or just after, is lost again; the others make
// updates all the while, and in the end the right one comes back.
TEST_F(JoinRun, WhoDoesNotFitOrDiesDisturbsNoOne) {
  WorkerProcesses workers(kWorld, [&](int rank) {
    run(rank, {}, [&](int sums) {
      if (rank == 1 && sums == kCallsPerUpdate + 1) ::raise(SIGKILL);
    });
    return true;
  });
  EXPECT_EQ(WTERMSIG(workers.wait(1)), SIGKILL);
  wait_for_updates({0, 2, 3}, kWorld - 1, 1);
  const auto refused = [&](const Start& start, const std::string& why) {
    WorkerProcesses process(1, [&](int) {
      try {
        run(1, start);
      } catch (const InputError& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return std::string(error.what()).find(why) != std::string::npos;
      }
      return false;
    });
    EXPECT_EQ(process.wait(0), 0) << why;
    wait_for_updates({0, 2, 3}, kWorld - 1, 1);
  };
  refused({.joins = true, .overrides = {"ppo.clip=0.1"}}, "its ppo.clip is 0.1");
  refused({.joins = true, .overrides = {"checkpoint_every=7"}}, "its checkpoint_every is 7");
  refused({.joins = true, .engine = "another"}, "its engine is another");
  for (const int sums : {1, kCallsPerUpdate + 1}) {
    shared().sums[1] = 0;
    WorkerProcesses dies(1, [&](int) {
      run(1, {.joins = true}, [&](int made) {
        if (made == sums) ::raise(SIGKILL);
      });
      return true;
    });
    EXPECT_EQ(WTERMSIG(dies.wait(0)), SIGKILL);
    wait_for_updates({0, 2, 3}, kWorld - 1, 1);
  }
  WorkerProcesses back(1, [&](int) { return run(1, {.joins = true}).guards.joined_workers == 3; });
  wait_for_updates({0, 1, 2, 3}, kWorld, 1);
  ::kill(workers.pid(0), SIGTERM);
  for (const int rank : {0, 2, 3}) EXPECT_EQ(workers.wait(rank), 0) << rank;
  EXPECT_EQ(back.wait(0), 0);
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/last.ckpt").members, (std::vector<int>{0, 1, 2, 3}));
}

}  // namespace
}  // namespace earshot
