// Workers on several hosts, each a network namespace: the bits of one host, and what happens when a cable is pulled.
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/curve_ring.h"
#include "tests/support/host_namespaces.h"
#include "trainer/curve_keys.h"
#include "trainer/zmq_ring.h"

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
    while (rounds[0] < 3) std::this_thread::sleep_for(milliseconds(5));
    event(workers);
    const auto start = Clock::now();
    EXPECT_EQ(workers.wait(0), 0);
    if (both_are_left) {
      EXPECT_EQ(workers.wait(1), 0);
    }
    // Four heartbeats of 0.5 s, one until the next beat, 0.3 s of grace; the rest is for a loaded machine.  The call's timeout is 20 s.
    EXPECT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 10.0);
  }
};

TEST_F(Lost, LinkIsNoticedOnBothSides) {
  expect_noticed(true, [&](WorkerProcesses&) { hosts_.set_link(1, false); });
}

TEST_F(Lost, KilledWorkerIsNoticedOnTheOtherHost) {
  expect_noticed(false, [](WorkerProcesses& workers) { ::kill(workers.pid(1), SIGKILL); });
}

}  // namespace
}  // namespace earshot
