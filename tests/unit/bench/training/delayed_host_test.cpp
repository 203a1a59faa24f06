// SPDX-License-Identifier: Apache-2.0
#include "bench/training/delayed_host.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/workers/curve_ring.h"

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

// The other host is there and takes nothing, as one that has been stopped: its queue is full, and this one ends all the same.
TEST(DelayedHost, EndsBesideAHostThatTakesNoPackets) {
  if (::geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  if (::access("/dev/net/tun", R_OK | W_OK) != 0) GTEST_SKIP() << "no /dev/net/tun";
  const PrivateTestFolder folder;
  sockaddr_un other{};
  other.sun_family = AF_UNIX;
  const std::string path = (folder.path() / "packets1").string();
  ASSERT_LT(path.size(), sizeof(other.sun_path));
  std::strcpy(static_cast<char*>(other.sun_path), path.c_str());
  const int queue = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::bind(queue, reinterpret_cast<const sockaddr*>(&other), sizeof(other)), 0);
  SharedArray<std::atomic<double>, 1> end_s;
  WorkerProcesses workers(1, [&](int) {
    auto host = std::make_unique<DelayedHost>(0, std::chrono::milliseconds(1), folder.path());
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(9);
    ::inet_pton(AF_INET, DelayedHost::address(1).c_str(), &to.sin_addr);
    const int udp = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    for (int packet = 0; packet < 5000; ++packet)  // a queue holds some hundred
      if (::sendto(udp, "x", 1, 0, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) != 1) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(200));  // the sender is held up
    const auto start = Clock::now();
    host.reset();
    end_s[0] = std::chrono::duration<double>(Clock::now() - start).count();
    return true;
  });
  workers.expect_all_succeed();
  ::close(queue);
  EXPECT_LT(end_s[0], 10);  // WorkerProcesses kills after 60 s
}

// What it had opened when it found that it cannot be is closed again.
TEST(DelayedHost, LeavesNoDescriptorWhereItCannotBe) {
  if (::geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  if (::access("/dev/net/tun", R_OK | W_OK) != 0) GTEST_SKIP() << "no /dev/net/tun";
  const PrivateTestFolder folder;
  WorkerProcesses workers(1, [&](int) {
    const auto open_descriptors = [] {
      return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), std::filesystem::directory_iterator{});
    };
    const auto before = open_descriptors();
    rlimit all{};
    if (::getrlimit(RLIMIT_NOFILE, &all) != 0) return false;
    // The packets' socket and the tun device can be opened, the socket that sets the device up cannot.
    std::array<int, 3> next{};
    for (int& descriptor : next) descriptor = ::dup(0);
    for (const int descriptor : next) ::close(descriptor);
    rlimit few = all;
    few.rlim_cur = static_cast<rlim_t>(next[2]);
    if (::setrlimit(RLIMIT_NOFILE, &few) != 0) return false;
    try {
      const DelayedHost host(0, kDelay, folder.path());
      return false;
    } catch (const RunError& error) {
      if (std::string(error.what()).find("a socket for the tun device cannot be opened") == std::string::npos) return false;
    }
    return ::setrlimit(RLIMIT_NOFILE, &all) == 0 && open_descriptors() == before;
  });
  workers.expect_all_succeed();
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
