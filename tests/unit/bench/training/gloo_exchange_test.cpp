// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/gloo_exchange.h"

#include <gtest/gtest.h>

#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/exchange_scenarios.h"
#include "trainer/launch/transport.h"

namespace earshot {
namespace {

class GlooCollective : public testing::Test {
 protected:
  void SetUp() override {
    if (!built_transports().gloo) GTEST_SKIP() << "this build has no Gloo (libgloo-dev was missing at configure time)";
  }
  /// Worker processes that meet in a file, or over tcp.
  void expect_succeeds(int world_size, const std::string& scenario, const std::string& rendezvous = {}) {
    const PrivateTestFolder folder;
    WorkerProcesses workers(world_size, [&](int rank) {
      ::alarm(300);
      RingConfig ring = ring_in(folder, rank, world_size);
      if (!rendezvous.empty()) ring.rendezvous = rendezvous;
      return ExchangeScenarios(ring.identity, folder.path(),
                               [&](std::chrono::milliseconds timeout) {
                                 ring.timeout = timeout;
                                 return make_ordered_collective(join_gloo(ring));
                               })
          .run(scenario);
    });
    workers.expect_all_succeed();
  }
};

TEST_F(GlooCollective, SumsEqualASerialSumInTheOrderOfTheRing) {
  for (const int world_size : {2, 3, 7}) expect_succeeds(world_size, "sums");
}
TEST_F(GlooCollective, SumsOf64Workers) { expect_succeeds(64, "sums"); }
TEST_F(GlooCollective, MeetsOverTcp) { expect_succeeds(3, "sums", "tcp://127.0.0.1:" + std::to_string(free_port())); }
TEST_F(GlooCollective, BroadcastGatherAndBarrier) { expect_succeeds(5, "messages"); }
TEST_F(GlooCollective, CallsInQuickSuccessionDoNotMix) { expect_succeeds(5, "succession"); }
TEST_F(GlooCollective, AnotherSizeOnOneWorkerIsAnErrorOnAll) { expect_succeeds(5, "other_size"); }
TEST_F(GlooCollective, AnotherCallOnOneWorkerIsAnErrorOnAll) { expect_succeeds(5, "other_call"); }
TEST_F(GlooCollective, CountsThoseThatWait) { expect_succeeds(6, "waiting"); }

// A worker that is killed is noticed by the end of its connections, long before the timeout of 120 s.
TEST_F(GlooCollective, AKilledWorkerIsNoticedAtOnce) {
  const PrivateTestFolder folder;
  const int world_size = 4;
  const auto start = std::chrono::steady_clock::now();
  WorkerProcesses workers(world_size, [&](int rank) {
    ::alarm(100);
    RingConfig ring = ring_in(folder, rank, world_size);
    return ExchangeScenarios(ring.identity, folder.path(),
                             [&](std::chrono::milliseconds timeout) {
                               ring.timeout = timeout;
                               return make_ordered_collective(join_gloo(ring));
                             })
        .run("killed");
  });
  for (int rank = 0; rank + 1 < world_size; ++rank) EXPECT_EQ(workers.wait(rank), 0) << rank;
  EXPECT_LT(seconds_since(start), 60);
}

TEST_F(GlooCollective, AWorkerThatDoesNotComeIsNamed) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(3, [&](int rank) {
    RingConfig ring = ring_in(folder, rank, 3);
    ring.timeout = std::chrono::milliseconds(2000);
    const auto gloo = make_ordered_collective(join_gloo(ring));
    gloo->barrier();
    if (rank == 1) {
      std::this_thread::sleep_for(std::chrono::seconds(6));
      return true;
    }
    return tells(run_error_of([&] { gloo->barrier(); }), {"worker 1", "did not take part in collective call 1"});
  });
  workers.expect_all_succeed();
}

TEST_F(GlooCollective, LinksThatLeaveTheHostNeedLeave) {
  RingConfig ring;
  ring.identity = {1, 2};
  ring.rendezvous = "tcp://192.0.2.1:29400";
  EXPECT_THROW(join_gloo(ring), InputError);
}

}  // namespace
}  // namespace earshot
