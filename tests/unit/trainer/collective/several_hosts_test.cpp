// SPDX-License-Identifier: Apache-2.0
// Workers on several hosts, each a network namespace: the bits of one host, and what happens when a cable is pulled.
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/host_namespaces.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kPort = 29400;

class SeveralHosts : public testing::Test {
 protected:
  void SetUp() override {
    if (!hosts_.missing().empty()) GTEST_SKIP() << hosts_.missing();
    write_curve_keys(keys_, make_curve_keys());
  }
  [[nodiscard]] RingConfig ring(const std::string& host, int rank, int world_size) const {
    return curve_ring(host, kPort, rank, world_size, keys_);
  }
  /// Hash of a few calls by `workers_per_host` workers on each of two hosts that meet at the address.
  [[nodiscard]] std::uint64_t hash_over(const std::string& address, int workers_per_host, const NetworkConfig* network = nullptr) const {
    const int world_size = 2 * workers_per_host;
    SharedArray<std::uint64_t, 8> hashes;
    WorkerProcesses workers(world_size, [&](int rank) {
      if (!hosts_.enter(rank / workers_per_host)) return false;
      RingConfig config = ring(address, rank, world_size);
      if (network != nullptr) config.network = *network;
      hashes[static_cast<std::size_t>(rank)] = hash_of_calls(*make_zmq_ring(config));
      return true;
    });
    workers.expect_all_succeed();
    for (std::size_t rank = 1; rank < static_cast<std::size_t>(world_size); ++rank) EXPECT_EQ(hashes[rank], hashes[0]) << rank;
    return hashes[0];
  }
  [[nodiscard]] std::uint64_t hash_of_one_host(int world_size) const {
    SharedArray<std::uint64_t, 8> hashes;
    WorkerProcesses workers(world_size, [&](int rank) {
      hashes[static_cast<std::size_t>(rank)] = hash_of_calls(*make_zmq_ring(ring_in(folder_, rank, world_size)));
      return true;
    });
    workers.expect_all_succeed();
    return hashes[0];
  }

  PrivateTestFolder folder_;
  std::filesystem::path keys_ = folder_.path() / "keys";
  HostNamespaces hosts_{2};
};

TEST_F(SeveralHosts, GiveTheBitsOfOneHost) {
  const std::uint64_t two = hash_of_one_host(2), four = hash_of_one_host(4);
  ASSERT_NE(two, four);
  EXPECT_EQ(hash_over(HostNamespaces::address(0), 1), two);
  EXPECT_EQ(hash_over(HostNamespaces::address_ipv6(0), 1), two);
  EXPECT_EQ(hash_over(HostNamespaces::address(0), 2), four);
  NetworkConfig insecure;
  insecure.insecure = true;
  EXPECT_EQ(hash_over(HostNamespaces::address(0), 1, &insecure), two);
  NetworkConfig chosen;
  chosen.curve_key_file = keys_.string();
  chosen.interface = "eth0";
  chosen.port_range = "29400-29440";  // the meeting point's port is among them
  EXPECT_EQ(hash_over(HostNamespaces::address(0), 2, &chosen), four);
}

/// Hash of sums of several chunks per host, twice in a row: floats and doubles.
std::uint64_t hash_of_large_sums(Collective& collective) {
  std::uint64_t hash = 0;
  const auto sum = [&]<class T>(std::vector<T> buffer) {
    for (std::size_t i = 0; i < buffer.size(); ++i)
      buffer[i] = static_cast<T>(std::sin(static_cast<double>(i * 17 + static_cast<std::size_t>(collective.identity().rank) * 7919)));
    collective.all_reduce_sum(std::span<T>(buffer));
    hash = hash64(std::as_bytes(std::span(buffer)), hash);
  };
  for (int round = 0; round < 2; ++round) {
    sum(std::vector<float>(900001));
    sum(std::vector<double>(200003));
    sum(std::vector<float>(16384));
  }
  return hash;
}

// From five workers of a host on each of them adds up a part.
TEST_F(SeveralHosts, ManyWorkersOfAHostGiveTheBitsOfTheRing) {
  std::uint64_t expected = 0;
  for (const bool shared_memory : {false, true}) {
    SharedArray<std::uint64_t, 7> hashes;
    WorkerProcesses workers(7, [&](int rank) {
      if (!hosts_.enter(rank == 0 ? 0 : 1)) return false;  // one and six
      RingConfig config = ring(HostNamespaces::address(0), rank, 7);
      config.network.shared_memory = shared_memory;
      ZmqRing collective(config);
      hashes[static_cast<std::size_t>(rank)] = hash_of_large_sums(collective);
      return collective.shares_memory_per_host() == shared_memory;
    });
    workers.expect_all_succeed();
    if (expected == 0) expected = hashes[0];
    for (std::size_t rank = 0; rank < 7; ++rank) EXPECT_EQ(hashes[rank], expected) << rank;
  }
}

// Workers of one host add up in shared memory where their ranks follow each other; the bits are those of the ring whatever the placement.
TEST_F(SeveralHosts, PlacementChangesNoBit) {
  struct Placement {
    std::vector<int> host_of_rank;
    bool shared_memory, shares;
  };
  const Placement placements[] = {{{0, 0, 1, 1}, false, false}, {{0, 0, 1, 1}, true, true},  {{0, 1, 1, 1}, true, true},
                                  {{0, 0, 0, 1}, true, true},   {{0, 1, 0, 1}, true, false}, {{0, 0, 0, 0}, true, false}};
  std::uint64_t expected = 0;
  for (const Placement& placement : placements) {
    SharedArray<std::uint64_t, 4> hashes;
    WorkerProcesses workers(4, [&](int rank) {
      if (!hosts_.enter(placement.host_of_rank[static_cast<std::size_t>(rank)])) return false;
      RingConfig config = ring(HostNamespaces::address(0), rank, 4);
      config.network.shared_memory = placement.shared_memory;
      ZmqRing collective(config);
      hashes[static_cast<std::size_t>(rank)] = hash_of_large_sums(collective);
      return collective.shares_memory_per_host() == placement.shares && collective.shares_memory() == (placement.host_of_rank.back() == 0);
    });
    workers.expect_all_succeed();
    if (expected == 0) expected = hashes[0];
    for (std::size_t rank = 0; rank < 4; ++rank) EXPECT_EQ(hashes[rank], expected) << rank;
  }
  EXPECT_NE(expected, 0u);
}

// The size differs within a host, or between hosts.
TEST_F(SeveralHosts, AnotherSizeOnOneWorkerIsAnErrorOnAll) {
  for (const int odd : {0, 1, 3}) {
    WorkerProcesses workers(4, [&](int rank) {
      if (!hosts_.enter(rank / 2)) return false;
      try {
        const auto collective = make_zmq_ring(ring(HostNamespaces::address(0), rank, 4));
        std::vector<float> buffer(rank == odd ? 1000000 : 1000001);
        collective->all_reduce_sum(buffer);
      } catch (const RunError& error) {
        return std::string(error.what()).find("worker ") != std::string::npos;
      }
      return false;
    });
    const auto start = Clock::now();
    workers.expect_all_succeed();
    EXPECT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 15.0);  // by the error, not by the timeout of 20 s
  }
}

TEST_F(SeveralHosts, DelayAndLossChangeNoBit) {
  if (!hosts_.disturb(0, "delay 2ms loss 1%") || !hosts_.disturb(1, "delay 2ms loss 1%"))
    GTEST_SKIP() << "this kernel has no netem (tc qdisc)";
  EXPECT_EQ(hash_over(HostNamespaces::address(0), 1), hash_of_one_host(2));
}

/// Two workers that sum until something is wrong; what happens to the second one after a while must be told by those that are left.
class Lost : public SeveralHosts {
 protected:
  template <class Event>
  void expect_noticed(bool both_are_left, Event&& event) {
    SharedArray<std::atomic<int>, 1> rounds;
    WorkerProcesses workers(2, [&](int rank) {
      if (!hosts_.enter(rank)) return false;
      const auto collective = make_zmq_ring(ring(HostNamespaces::address(0), rank, 2));
      std::vector<float> buffer(1000000, 1.0f);
      try {
        while (true) {
          collective->all_reduce_sum(buffer);
          if (rank == 0) ++rounds[0];
        }
      } catch (const RunError& error) {
        const std::string expected = "worker " + std::to_string(1 - rank);
        return std::string(error.what()).find(expected) != std::string::npos;
      }
    });
    ASSERT_TRUE(workers.wait_until([&] { return rounds[0] >= 3; }));
    event(workers);
    const auto start = Clock::now();
    EXPECT_EQ(workers.wait(0), 0);
    if (both_are_left) {
      EXPECT_EQ(workers.wait(1), 0);
    }
    // Four heartbeats of 0.5 s, one until the next beat, 0.3 s of grace; the rest is for a loaded machine.  The call's timeout is 20 s.
    EXPECT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 10.0);
  }

  /// Two workers on each of two hosts, so that sums go through shared memory on each: those that are left name `named` within seconds.
  void expect_named_by_all(const std::string& named, const std::vector<int>& left, const std::function<void(WorkerProcesses&)>& loss) {
    SharedArray<std::atomic<int>, 1> rounds;
    WorkerProcesses workers(4, [&](int rank) {
      if (!hosts_.enter(rank / 2)) return false;
      ZmqRing collective(ring(HostNamespaces::address(0), rank, 4));
      std::vector<float> buffer(1000000, 1.0f);
      try {
        while (true) {
          collective.all_reduce_sum(buffer);
          if (rank == 1) ++rounds[0];
        }
      } catch (const RunError& error) {
        return collective.shares_memory_per_host() && std::string(error.what()).find(named) != std::string::npos;
      }
    });
    ASSERT_TRUE(workers.wait_until([&] { return rounds[0] >= 3; }));
    loss(workers);
    const auto start = Clock::now();
    for (const int rank : left) EXPECT_EQ(workers.wait(rank), 0) << rank << " names " << named;
    const double took_s = std::chrono::duration<double>(Clock::now() - start).count();
    std::printf("%s: noticed by all within %.0f ms\n", named.c_str(), 1000 * took_s);
    EXPECT_LT(took_s, 10.0);
  }
};

TEST_F(Lost, LinkIsNoticedOnBothSides) {
  expect_noticed(true, [&](WorkerProcesses&) { hosts_.set_link(1, false); });
}

TEST_F(Lost, KilledWorkerIsNoticedOnTheOtherHost) {
  expect_noticed(false, [](WorkerProcesses& workers) { ::kill(workers.pid(1), SIGKILL); });
}

TEST_F(Lost, OneOfAHostThatSharesMemoryIsNamedByAll) {
  const auto kill_one = [&](int victim, const std::vector<int>& left) {
    expect_named_by_all("worker " + std::to_string(victim), left, [&](WorkerProcesses& workers) { ::kill(workers.pid(victim), SIGKILL); });
  };
  kill_one(3, {0, 1, 2});  // the second of its host
  kill_one(2, {0, 1, 3});  // both leaders
  kill_one(0, {1, 2, 3});
}

TEST_F(Lost, ACutLinkBetweenHostsThatShareMemoryIsNoticedByAll) {
  expect_named_by_all("worker ", {0, 1, 2, 3}, [&](WorkerProcesses&) { hosts_.set_link(1, false); });
}

}  // namespace
}  // namespace earshot
