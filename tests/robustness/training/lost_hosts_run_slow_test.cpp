// SPDX-License-Identifier: Apache-2.0
// A run of eight workers on four hosts, each host a network namespace, that trains on without one worker killed, one stopped, and one host
// whose cable is pulled: checks the time of each, equal bits on the remaining workers, and the files.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <span>
#include <thread>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/hooked_collective.h"
#include "tests/support/workers/host_namespaces.h"
#include "tests/support/workers/training_run.h"
#include "trainer/net/curve_keys.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kHosts = 4, kPerHost = 2, kWorld = kHosts * kPerHost, kPort = 29430;
constexpr unsigned kAlarm_s = 240;
constexpr double kLongestPause_s = 2;  // between the event and the next sum of those that are left

/// What each worker tells the test of the last sum of a gradient that it has got.
struct Shared {
  std::atomic<int> sums[kWorld];
  std::atomic<int> world[kWorld];                    ///< members then
  std::atomic<double> first_at[kWorld + 1][kWorld];  ///< by members, rank: when the first sum of so many came, in s; 0: none yet
  std::atomic<std::uint64_t> hash[kWorld];           ///< of all sums since the last change of members
};

double now_s() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

class LostHostsRun : public TrainingRun {
 protected:
  LostHostsRun() : TrainingRun("checkpoint_every: 1\nkeep: 3\ntotal_steps: 1000000\n", "", ", normalize_advantages: true") {}
  void SetUp() override {
    if (!hosts_.missing().empty()) GTEST_SKIP() << hosts_.missing();
    write_curve_keys(keys_, make_curve_keys());
    TrainingRun::SetUp();
  }
  Shared& shared() { return shared_[0]; }

  TrainReport run(int rank) {
    ::alarm(kAlarm_s);
    if (!hosts_.enter(rank / kPerHost)) throw RunError("namespace", "cannot be entered");
    const RunConfig config = config_with({"network.on_loss=continue"});
    RingConfig ring = curve_ring(HostNamespaces::address(0), kPort, rank, kWorld, keys_);
    ring.network.on_loss = config.network.on_loss;
    ring.heartbeat = std::chrono::milliseconds(150);  // as workers of such runs have it
    const auto inner = make_zmq_ring(ring);
    HookedCollective collective(*inner, {}, [&](std::span<float> sum) {
      const int world = inner->identity().world_size;
      auto& hash = shared().hash[rank];
      if (shared().world[rank].exchange(world) != world) {
        hash = 0;
        shared().first_at[world][rank] = now_s();
      }
      hash = hash64(std::as_bytes(sum), hash);
      ++shared().sums[rank];
    });
    return train(config, collective, {});
  }
  void wait_for(const std::function<bool()>& condition) { EXPECT_TRUE(wait_until(condition, 60)); }
  /// All of these train, as so many.
  void wait_for_updates(const std::vector<int>& ranks) {
    for (const int rank : ranks) wait_for([&] { return shared().world[rank] == static_cast<int>(ranks.size()); });
    for (const int rank : ranks) {
      const int from = shared().sums[rank];
      wait_for([&] { return shared().sums[rank] >= from + 3 * kCallsPerUpdate; });
    }
  }
  /// Those that are left train on, soon after what began at `began_s`.
  void expect_they_go_on(const std::vector<int>& left, double began_s, const char* event) {
    wait_for_updates(left);
    double longest_s = 0;
    for (const int rank : left) longest_s = std::max(longest_s, shared().first_at[left.size()][rank] - began_s);
    std::printf("%s: the %zu that are left have their next sum after %.2f s at most\n", event, left.size(), longest_s);
    EXPECT_LT(longest_s, kLongestPause_s) << event;
  }

  std::filesystem::path keys_ = folder_.path() / "keys";
  HostNamespaces hosts_{kHosts};
  SharedArray<Shared, 1> shared_;
};

TEST_F(LostHostsRun, TrainsOnWithoutAKilledAStoppedAndACutOffOne) {
  WorkerProcesses workers(kWorld, [&](int rank) {
    try {
      const TrainReport report = run(rank);
      return (rank == 0 || rank == 1 || rank == 2 || rank == 4) && report.guards.lost_workers == 4;
    } catch (const LeftOut& error) {
      std::fprintf(stderr, "worker %d: %s\n", rank, error.what());
      return rank == 3 || rank == 6 || rank == 7;
    }
  });
  wait_for_updates({0, 1, 2, 3, 4, 5, 6, 7});

  double began_s = now_s();
  ::kill(workers.pid(5), SIGKILL);
  expect_they_go_on({0, 1, 2, 3, 4, 6, 7}, began_s, "killed");
  EXPECT_EQ(WTERMSIG(workers.wait(5)), SIGKILL);

  began_s = now_s();
  ::kill(workers.pid(3), SIGSTOP);
  expect_they_go_on({0, 1, 2, 4, 6, 7}, began_s, "stopped");

  began_s = now_s();
  hosts_.set_link(3, false);
  expect_they_go_on({0, 1, 2, 4}, began_s, "cut off");
  std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, began_s + 5 - now_s())));
  hosts_.set_link(3, true);
  ::kill(workers.pid(3), SIGCONT);
  // Back, they have no part in it any more, and disturb no one.
  for (const int rank : {3, 6, 7}) EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank;
  wait_for_updates({0, 1, 2, 4});
  ::kill(workers.pid(2), SIGTERM);  // all end after the same update
  for (const int rank : {0, 1, 2, 4}) EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank;

  for (const int rank : {1, 2, 4}) EXPECT_EQ(shared().hash[rank], shared().hash[0]) << "worker " << rank;
  EXPECT_NE(shared().hash[0], 0u);
  const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
  EXPECT_EQ(last.world_size, 4);
  EXPECT_EQ(last.started_workers, kWorld);
  EXPECT_EQ(last.members, (std::vector<int>{0, 1, 2, 4}));
  EXPECT_EQ(last_value("guards/lost_workers"), 4);
  const auto points = read_event_log(out() / "events.jsonl");
  int left_out = 0;  // a worker that is lost while an update is reported takes its point along
  for (std::size_t i = 1; i < points.size(); ++i) {
    EXPECT_GT(points[i].update, points[i - 1].update);
    left_out += static_cast<int>(points[i].update - points[i - 1].update) - 1;
  }
  EXPECT_LE(left_out, 3);
  EXPECT_EQ(points.back().update, last.update);
}

}  // namespace
}  // namespace earshot
