// SPDX-License-Identifier: Apache-2.0
// Workers that come back on several hosts, each a network namespace: who listens for them moves from host to host.
#include <gtest/gtest.h>
#include <signal.h>

#include <array>

#include "sim/base/errors.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/host_namespaces.h"
#include "tests/support/workers/joining_workers.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

constexpr int kJoiningPort = 29420;

class JoiningWorkersOfHosts : public JoiningWorkers {
 protected:
  void SetUp() override {
    if (!hosts_.missing().empty()) GTEST_SKIP() << hosts_.missing();
    write_curve_keys(keys_, make_curve_keys());
  }
  /// A worker on its host, which looks for the meeting point where it is at that time.
  RingConfig ring(int rank, int world_size) override {
    if (!hosts_.enter(host_of_[static_cast<std::size_t>(rank)])) throw RunError("namespace", "cannot be entered");
    return joinable(curve_ring(HostNamespaces::address(meeting_host_), kJoiningPort, rank, world_size, keys_));
  }
  void lose(WorkerProcesses& workers, int process, const std::vector<int>& left) {
    ::kill(workers.pid(process), SIGKILL);
    wait_for_rounds(left, static_cast<int>(left.size()));
  }

  std::filesystem::path keys_ = folder_.path() / "keys";
  HostNamespaces hosts_{4};
  std::array<int, 4> host_of_{0, 1, 2, 3};
  int meeting_host_ = 0;
};

// Each time the worker that listens is lost, the lowest of those that are left listens at its own address: also where it has joined at
// another host's, and whatever its rank.
TEST_F(JoiningWorkersOfHosts, TheMeetingPointMovesToTheHostOfWhoTakesItOver) {
  WorkerProcesses workers(4, member(4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  lose(workers, 0, {1, 2, 3});
  meeting_host_ = 1;
  host_of_[0] = 3;  // rank 0 comes back elsewhere
  WorkerProcesses first(1, joiner(0, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  lose(workers, 1, {0, 2, 3});
  meeting_host_ = 3;
  WorkerProcesses second(1, joiner(1, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  lose(first, 0, {1, 2, 3});
  meeting_host_ = 1;
  host_of_[0] = 0;
  WorkerProcesses again(1, joiner(0, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  end(workers, {2, 3});
  EXPECT_EQ(second.wait(0), 0);
  EXPECT_EQ(again.wait(0), 0);
  EXPECT_EQ(shared().joined, 3);
}

}  // namespace
}  // namespace earshot
