#include "trainer/delayed_host.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>

#include "sim/base/errors.h"
#include "tests/support/curve_ring.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kDelay(20);

// Two workers over links of 20 ms have the bits of two on one host, and no exchange takes less than the delay.
TEST(DelayedHost, PacketsTakeTheDelayAndNoBitIsLost) {
  if (::geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  if (::access("/dev/net/tun", R_OK | W_OK) != 0) GTEST_SKIP() << "no /dev/net/tun";
  const PrivateTestFolder folder;
  SharedArray<std::uint64_t, 4> hashes;
  SharedArray<std::atomic<double>, 2> mean_s, least_s;  ///< of ten exchanges
  {
    WorkerProcesses workers(2, [&](int rank) {
      const DelayedHost host(rank, kDelay, folder.path());
      RingConfig config = ring_in(folder, rank, 2);
      config.rendezvous = "tcp://" + DelayedHost::address(0) + ":29400";
      config.network.insecure = true;
      const auto ring = make_zmq_ring(config);
      const auto r = static_cast<std::size_t>(rank);
      hashes[r] = hash_of_calls(*ring);
      ring->barrier();
      double least = 1e9;
      const auto begin = Clock::now();
      for (int call = 0; call < 10; ++call) {
        const auto start = Clock::now();
        ring->barrier();
        least = std::min(least, std::chrono::duration<double>(Clock::now() - start).count());
      }
      mean_s[r] = std::chrono::duration<double>(Clock::now() - begin).count() / 10;
      least_s[r] = least;
      return true;
    });
    workers.expect_all_succeed();
  }
  WorkerProcesses workers(2, [&](int rank) {
    hashes[static_cast<std::size_t>(rank) + 2] = hash_of_calls(*make_zmq_ring(ring_in(folder, rank, 2)));
    return true;
  });
  workers.expect_all_succeed();
  for (std::size_t i = 1; i < 4; ++i) EXPECT_EQ(hashes[i], hashes[0]) << i;
  for (std::size_t r = 0; r < 2; ++r) {
    EXPECT_GE(mean_s[r], 0.020);
    EXPECT_LT(least_s[r], 0.039);  // one way, not there and back; the least of ten, as the machine may be loaded
  }
}

TEST(DelayedHost, SaysWhatItNeeds) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(1, [&](int) {
    if (::geteuid() == 0 && (::setgid(65534) != 0 || ::setuid(65534) != 0)) return false;
    try {
      const DelayedHost host(0, kDelay, folder.path());  // not ours any more
    } catch (const RunError& error) {
      return std::string(error.what()).find("needs root") != std::string::npos;
    }
    return false;
  });
  workers.expect_all_succeed();
}

}  // namespace
}  // namespace earshot
