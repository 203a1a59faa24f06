// SPDX-License-Identifier: Apache-2.0
// Time of a gradient's sum between two hosts of two workers each, by the ring over workers and by shared memory on each host, in turn.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/host_namespaces.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kWorld = 4, kRounds = 31;
constexpr std::size_t kGradient = 4952453;

class SeveralHostsSpeed : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Links, SeveralHostsSpeed, testing::Bool(), [](const auto& test) { return test.param ? "Curve" : "Plain"; });

double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

TEST_P(SeveralHostsSpeed, SharedMemoryOnEachHostIsFasterThanTheRing) {
  const HostNamespaces hosts(2);
  if (!hosts.missing().empty()) GTEST_SKIP() << hosts.missing();
  const PrivateTestFolder folder;
  const std::filesystem::path keys = folder.path() / "keys";
  write_curve_keys(keys, make_curve_keys());
  SharedArray<double, 2 * kRounds> ms;  // of rank 0
  const int port = free_ports(2);
  WorkerProcesses workers(kWorld, [&](int rank) {
    if (!hosts.enter(rank / 2)) return false;
    const auto connect = [&](int port, bool shared_memory) {
      RingConfig config = curve_ring(HostNamespaces::address(0), port, rank, kWorld, keys);
      config.network.shared_memory = shared_memory;
      if (!GetParam()) config.network.curve_key_file.clear(), config.network.insecure = true;
      return std::make_unique<ZmqRing>(config);
    };
    const auto ring = connect(port, false), hierarchy = connect(port + 1, true);
    std::vector<float> buffer(kGradient);
    std::uint64_t hashes[2] = {};
    for (std::size_t round = 0; round < 2 * kRounds; ++round) {
      ZmqRing& collective = round % 2 == 0 ? *ring : *hierarchy;
      for (std::size_t i = 0; i < buffer.size(); ++i)
        buffer[i] = std::sin(static_cast<float>(i % 10007 + static_cast<std::size_t>(rank) * 31));
      collective.barrier();
      const auto start = Clock::now();
      collective.all_reduce_sum(buffer);
      if (rank == 0) ms[round] = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
      hashes[round % 2] = hash64(std::as_bytes(std::span(buffer)));
    }
    return !ring->shares_memory_per_host() && hierarchy->shares_memory_per_host() && hashes[0] == hashes[1];
  });
  workers.expect_all_succeed();
  std::vector<double> by_ring, by_hierarchy, ratios;
  for (std::size_t round = 0; round < kRounds; ++round) {
    by_ring.push_back(ms[2 * round]);
    by_hierarchy.push_back(ms[2 * round + 1]);
    ratios.push_back(by_hierarchy.back() / by_ring.back());
  }
  std::printf("%zu bytes, 2 hosts x 2 workers, %s: ring %.1f ms, shared memory per host %.1f ms, median of ratios %.2f\n",
              kGradient * sizeof(float), GetParam() ? "CURVE" : "plain tcp", median(by_ring), median(by_hierarchy), median(ratios));
  EXPECT_LT(median(ratios), 1.0);
}

}  // namespace
}  // namespace earshot
