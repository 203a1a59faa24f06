// SPDX-License-Identifier: Apache-2.0
// Workers that go on without a lost one: killed, stopped, cut off, in a loop without end, or with a broken connection.
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/seconds_since.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/host_namespaces.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kWorld = 4, kVictim = 1;
constexpr std::size_t kElements = 300001;  // round the ring in more than one chunk

RingConfig lasting_ring(RingConfig config) {
  config.network.on_loss = OnLoss::go_on;
  config.heartbeat = milliseconds(150);
  return config;
}

/// Sums until told to end, going on without whom it loses.
struct Summing {
  explicit Summing(Collective& workers) : collective(workers), rank(workers.identity().rank) {}

  /// One sum, small or large; false where a change of membership took its place.
  bool sum_once() {
    const auto members = collective.members();
    buffer.assign(rounds % 2 == 0 ? kElements : 5, 0.f);
    double expected = 0;
    for (const int member : members) expected += 1 << member;
    std::fill(buffer.begin(), buffer.end(), static_cast<float>(1 << rank));
    ++rounds;
    try {
      collective.all_reduce_sum(buffer);
    } catch (const MembershipChange& change) {
      lost.insert(lost.end(), change.lost().begin(), change.lost().end());
      ++changes;
      rounds = 0;  // all are at the same call again
      return false;
    }
    for (const float value : buffer) right = right && static_cast<double>(value) == expected;
    return true;
  }

  Collective& collective;
  int rank, changes = 0, rounds = 0;
  bool right = true;
  std::vector<int> lost;
  std::vector<float> buffer;
};

class LostWorkers : public testing::Test {
 protected:
  /// Four workers that sum; `event` befalls the second.  The others must notice within the bound, and make twenty sums of theirs.
  using Victim = std::function<void(Collective&)>;
  void expect_others_go_on(const std::function<void(pid_t)>& event, double noticed_within_s, const Victim& victim = {},
                           const std::function<RingConfig(int rank)>& ring = {}) {
    SharedArray<std::atomic<int>, 2> state;  // sums of the first worker; the event has been
    SharedArray<double, kWorld> noticed_at;
    const auto start = Clock::now();
    WorkerProcesses workers(kWorld, [&](int rank) {
      const auto collective = make_zmq_ring(lasting_ring(ring ? ring(rank) : ring_in(folder_, rank, kWorld)));
      Summing summing(*collective);
      int after = 0;
      try {
        while (after < 20) {
          const bool summed = summing.sum_once();
          if (!summed) noticed_at[static_cast<std::size_t>(rank)] = seconds_since(start);
          if (rank == 0) ++state[0];
          after += summed && summing.changes > 0;
          if (rank == kVictim && state[0] > 10 && victim) victim(*collective);
        }
      } catch (const RunError& error) {
        const std::string message = error.what();
        std::fprintf(stderr, "worker %d ends: %s\n", rank, message.c_str());
        return rank == kVictim && message.find("worker 1") != std::string::npos && message.find('\n') == std::string::npos;
      }
      const bool expected = summing.right && summing.lost == std::vector<int>{kVictim} && collective->identity().world_size == kWorld - 1 &&
                            collective->members() == std::vector<int>({0, 2, 3});
      return rank != kVictim && expected;
    });
    ASSERT_TRUE(workers.wait_until([&] { return state[0] >= 10; }));
    const double event_at = seconds_since(start);
    event(workers.pid(kVictim));
    for (const int rank : {0, 2, 3}) {
      EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank;
      const double took = noticed_at[static_cast<std::size_t>(rank)] - event_at;
      std::printf("worker %d goes on %.0f ms after the event\n", rank, 1000 * took);
      // Half a second more for a loaded machine.
      EXPECT_LT(took, noticed_within_s + 0.5);
    }
    ::kill(workers.pid(kVictim), SIGCONT);
    status_of_victim_ = workers.wait(kVictim);
  }

  PrivateTestFolder folder_;
  int status_of_victim_ = -1;
};

TEST_F(LostWorkers, KilledOneIsLeftBehind) {
  expect_others_go_on([](pid_t pid) { ::kill(pid, SIGKILL); }, 0.1);
  EXPECT_EQ(WTERMSIG(status_of_victim_), SIGKILL);
}

TEST_F(LostWorkers, StoppedOneIsLeftBehindAndEndsWhenItWakes) {
  expect_others_go_on([](pid_t pid) { ::kill(pid, SIGSTOP); }, 1.0);
  EXPECT_EQ(status_of_victim_, 0);  // with one line that names it
}

// It wakes while the others still train, and must not wait for them until a time-out.
TEST_F(LostWorkers, AStoppedOneThatWakesIsToldAtOnce) {
  SharedArray<std::atomic<int>, 2> state;  // sums since the loss; the one that woke has ended
  WorkerProcesses workers(3, [&](int rank) {
    const auto collective = make_zmq_ring(lasting_ring(ring_in(folder_, rank, 3)));
    Summing summing(*collective);
    try {
      while (state[1] == 0 || summing.rounds % 4 != 0) {
        if (summing.sum_once() && summing.changes > 0 && rank == 0) ++state[0];
        std::this_thread::sleep_for(milliseconds(5));
        if (rank == 1 && summing.changes == 0 && summing.rounds == 8) ::raise(SIGSTOP);
      }
    } catch (const LeftOut& error) {
      std::fprintf(stderr, "worker %d ends: %s\n", rank, error.what());
      return rank == 1;
    } catch (const RunError&) {
      return rank != 1;  // the other one has seen the end earlier
    }
    return rank != 1 && summing.right;
  });
  ASSERT_TRUE(workers.wait_until([&] { return state[0] >= 20; }));
  ::kill(workers.pid(1), SIGCONT);
  const auto woken = Clock::now();
  EXPECT_EQ(workers.wait(1), 0);
  std::printf("ended %.0f ms after it woke\n", 1000 * seconds_since(woken));
  EXPECT_LT(seconds_since(woken), 10.0);
  state[1] = 1;
  EXPECT_EQ(workers.wait(0), 0);
  EXPECT_EQ(workers.wait(2), 0);
}

// Its heart beats, since that is another thread; but its loop is in one place.
TEST_F(LostWorkers, OneInAnEndlessLoopIsLeftBehind) {
  const auto ring = [&](int rank) {
    RingConfig config = ring_in(folder_, rank, kWorld);
    config.network.progress_timeout_s = 1;
    return config;
  };
  const auto loop = [](Collective&) { std::this_thread::sleep_for(std::chrono::seconds(3)); };
  expect_others_go_on([](pid_t) {}, 1.5, loop, ring);
  EXPECT_EQ(status_of_victim_, 0);
}

// Slow is not stuck: a worker that says that it gets on is waited for, longer than the time in which it has to get on.
TEST_F(LostWorkers, ASlowOneIsWaitedFor) {
  WorkerProcesses workers(3, [&](int rank) {
    RingConfig config = lasting_ring(ring_in(folder_, rank, 3));
    config.network.progress_timeout_s = 0.6;
    config.timeout = milliseconds(900);
    const auto collective = make_zmq_ring(config);
    for (int i = 0; rank == 2 && i < 40; ++i) {
      std::this_thread::sleep_for(milliseconds(50));
      collective->note_progress();
    }
    std::vector<float> buffer(10, 1.f);
    collective->all_reduce_sum(buffer);
    return buffer[0] == 3.f && collective->identity().world_size == 3;
  });
  workers.expect_all_succeed();
}

// Those that have begun the next call are counted before it, also where a change of membership has set the numbers of calls back.
TEST_F(LostWorkers, WaitingOnesAreCounted) {
  SharedArray<std::atomic<int>, 1> ready;
  WorkerProcesses workers(4, [&](int rank) {
    const auto collective = make_zmq_ring(lasting_ring(ring_in(folder_, rank, 4)));
    const auto all_come_to = [&](std::size_t others) {
      if (rank == 0 && collective->num_waiting() > static_cast<int>(others)) return false;
      if (rank == 0 && !wait_until([&] { return collective->num_waiting() >= static_cast<int>(others); }, 20)) return false;
      return collective->all_gather(std::to_string(rank)).size() == others + 1;
    };
    for (int call = 0; call < 5; ++call)
      if (!all_come_to(3)) return false;
    ++ready[0];
    Summing summing(*collective);
    if (rank == 3) ::pause();
    while (summing.changes == 0) summing.sum_once();
    return all_come_to(2) && all_come_to(2);
  });
  ASSERT_TRUE(workers.wait_until([&] { return ready[0] >= 4; }));
  ::kill(workers.pid(3), SIGKILL);
  for (const int rank : {0, 1, 2}) EXPECT_EQ(workers.wait(rank), 0) << rank;
}

/// Closes the worker's connections for gradients, as a machine between two hosts may.
int break_bulk_connections() {
  int broken = 0;
  for (int descriptor = 3; descriptor < 256; ++descriptor) {
    sockaddr_un peer{};
    socklen_t size = sizeof(peer);
    if (::getpeername(descriptor, reinterpret_cast<sockaddr*>(&peer), &size) != 0 || peer.sun_family != AF_UNIX) continue;
    if (std::string(peer.sun_path).ends_with(".bulk")) broken += ::shutdown(descriptor, SHUT_RDWR) == 0;
  }
  return broken;
}

/// Workers on one host that send their sums.
RingConfig sending_ring(RingConfig config) {
  config.network.shared_memory = false;
  return config;
}

TEST_F(LostWorkers, ABrokenConnectionIsOpenedAnew) {
  WorkerProcesses workers(3, [&](int rank) {
    const auto collective = make_zmq_ring(sending_ring(lasting_ring(ring_in(folder_, rank, 3))));
    Summing summing(*collective);
    for (int i = 0; i < 10; ++i) summing.sum_once();
    if (rank == 1 && break_bulk_connections() != 1) return false;
    for (int after = 0; after < 20;) after += summing.sum_once() && summing.changes > 0;
    return summing.right && summing.changes == 1 && summing.lost.empty() && collective->identity().world_size == 3;
  });
  workers.expect_all_succeed();
}

TEST_F(LostWorkers, ABrokenConnectionEndsARunThatDoesNotGoOn) {
  WorkerProcesses workers(3, [&](int rank) {
    const auto collective = make_zmq_ring(sending_ring(ring_in(folder_, rank, 3)));
    std::vector<float> buffer(kElements);
    collective->all_reduce_sum(buffer);
    if (rank == 1 && break_bulk_connections() != 1) return false;
    const auto start = Clock::now();
    try {
      while (true) collective->all_reduce_sum(buffer);
    } catch (const RunError& error) {
      return std::string(error.what()).find("worker 1") != std::string::npos && seconds_since(start) < 5;
    }
  });
  workers.expect_all_succeed();
}

// Sums that go through shared memory need no connection for gradients: the run neither ends nor changes, however long it is broken, and
// whether a worker waits in a sum or in a call that sends messages.
TEST_F(LostWorkers, ABrokenConnectionIsNoMatterToSumsInSharedMemory) {
  for (const bool goes_on : {false, true}) {
    const PrivateTestFolder folder;
    WorkerProcesses workers(3, [&](int rank) {
      const RingConfig config = ring_in(folder, rank, 3);
      const auto collective = make_zmq_ring(goes_on ? lasting_ring(config) : config);
      Summing summing(*collective);
      for (int i = 0; i < 10; ++i) summing.sum_once();
      if (rank == 1 && break_bulk_connections() != 1) return false;
      for (int i = 0; i < 40; ++i) {  // 1.6 s: longer than the timeout of a connection that carries sums
        if (rank == 2) std::this_thread::sleep_for(milliseconds(40));
        summing.sum_once();
        if (collective->all_gather(std::to_string(rank)).size() != 3) return false;
      }
      return summing.right && summing.changes == 0;
    });
    workers.expect_all_succeed();
  }
}

// Those that are left after a loss send their sums, also where one of their connections had broken unnoticed before.
TEST_F(LostWorkers, AConnectionThatBrokeUnderSharedMemoryIsOpenedAnewForTheRing) {
  WorkerProcesses workers(kWorld, [&](int rank) {
    const auto collective = make_zmq_ring(lasting_ring(ring_in(folder_, rank, kWorld)));
    Summing summing(*collective);
    for (int i = 0; i < 10; ++i) summing.sum_once();
    if (rank == 2 && break_bulk_connections() != 1) return false;
    for (int i = 0; i < 20; ++i) summing.sum_once();
    if (rank == 3) ::raise(SIGKILL);
    for (int after = 0; after < 20;) after += summing.sum_once() && summing.changes > 0;
    return summing.right && summing.changes == 1 && summing.lost == std::vector<int>{3};
  });
  for (const int rank : {0, 1, 2}) EXPECT_EQ(workers.wait(rank), 0) << rank;
  EXPECT_EQ(WTERMSIG(workers.wait(3)), SIGKILL);
}

TEST_F(LostWorkers, TwoAtOnceAndOneAfterTheOther) {
  for (const int pause_ms : {0, 30, 400}) {
    const PrivateTestFolder folder;
    SharedArray<std::atomic<int>, 1> sums;
    WorkerProcesses workers(8, [&](int rank) {
      const auto collective = make_zmq_ring(lasting_ring(ring_in(folder, rank, 8)));
      Summing summing(*collective);
      for (int after = 0; after < 20;) {
        after += summing.sum_once() && summing.lost.size() == 3;
        if (rank == 7) ++sums[0];
      }
      std::ranges::sort(summing.lost);
      return summing.right && summing.lost == std::vector<int>({0, 3, 5}) && collective->members() == std::vector<int>({1, 2, 4, 6, 7});
    });
    ASSERT_TRUE(workers.wait_until([&] { return sums[0] >= 5; }));
    for (const int victim : {3, 0, 5}) {
      ::kill(workers.pid(victim), SIGKILL);
      std::this_thread::sleep_for(milliseconds(pause_ms));
    }
    for (const int rank : {1, 2, 4, 6, 7}) EXPECT_EQ(workers.wait(rank), 0) << rank << " at " << pause_ms;
  }
}

// Of two workers the one that is left cannot know whether the other goes on: only the lower rank does.
TEST_F(LostWorkers, OfTwoOnlyTheFirstGoesOn) {
  for (const int victim : {0, 1}) {
    const PrivateTestFolder folder;
    SharedArray<std::atomic<int>, 1> ready;
    WorkerProcesses workers(2, [&](int rank) {
      const auto collective = make_zmq_ring(lasting_ring(ring_in(folder, rank, 2)));
      Summing summing(*collective);
      ++ready[0];
      try {
        for (int after = 0; after < 5;) after += summing.sum_once() && summing.changes > 0;
      } catch (const RunError& error) {
        return rank == 1 && std::string(error.what()).find("reaches only worker 1 of 0, 1") != std::string::npos;
      }
      return rank == 0 && summing.right && collective->identity().world_size == 1;
    });
    ASSERT_TRUE(workers.wait_until([&] { return ready[0] >= 2; }));
    ::kill(workers.pid(victim), SIGKILL);
    EXPECT_EQ(workers.wait(1 - victim), 0);
  }
}

/// The same between hosts, which are network namespaces: a cable is pulled for five seconds.
class LostHosts : public LostWorkers {
 protected:
  void SetUp() override {
    if (!hosts_.missing().empty()) GTEST_SKIP() << hosts_.missing();
    write_curve_keys(keys_, make_curve_keys());
  }
  std::filesystem::path keys_ = folder_.path() / "keys";
  HostNamespaces hosts_{kWorld};
};

TEST_F(LostHosts, ACutOffOneIsLeftBehindAndEnds) {
  const auto ring = [&](int rank) {
    if (!hosts_.enter(rank)) throw RunError("namespace", "cannot be entered");
    return curve_ring(HostNamespaces::address(0), 29410, rank, kWorld, keys_);
  };
  std::thread cable;
  expect_others_go_on(
      [&](pid_t) {
        hosts_.set_link(kVictim, false);
        cable = std::thread([&] {
          std::this_thread::sleep_for(std::chrono::seconds(5));
          hosts_.set_link(kVictim, true);
        });
      },
      1.6, {}, ring);
  cable.join();
  EXPECT_EQ(status_of_victim_, 0);
}

// Workers of one host share memory, two and two; those that are left send their sums.
TEST_F(LostHosts, OneOfAHostThatSharesMemoryIsLeftBehind) {
  const auto ring = [&](int rank) {
    if (!hosts_.enter(rank / 2)) throw RunError("namespace", "cannot be entered");
    return curve_ring(HostNamespaces::address(0), 29410, rank, kWorld, keys_);
  };
  expect_others_go_on([](pid_t pid) { ::kill(pid, SIGKILL); }, 0.4, {}, ring);
  EXPECT_EQ(WTERMSIG(status_of_victim_), SIGKILL);
}

}  // namespace
}  // namespace earshot
