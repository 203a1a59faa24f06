// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/host_ring.h"

#include <gtest/gtest.h>

#include <deque>
#include <map>
#include <numeric>

namespace earshot {
namespace {

TEST(HostLayout, FollowsRanks) {
  const auto layout = contiguous_hosts({"a", "a", "b", "", "", "c", "c", "c"});
  ASSERT_TRUE(layout);
  EXPECT_EQ(layout->first, (std::vector<int>{0, 2, 3, 4, 5, 8}));
  EXPECT_EQ(layout->num_hosts(), 5);
  EXPECT_EQ(layout->host_of(1), 0);
  EXPECT_EQ(layout->host_of(4), 3);
  EXPECT_EQ(layout->host_of(7), 4);
  EXPECT_EQ(layout->num_workers(4), 3);
  EXPECT_TRUE(layout->shares());
  EXPECT_FALSE(contiguous_hosts({"a", "b", ""})->shares());
  EXPECT_FALSE(contiguous_hosts({"a", "b", "a"}));
}

TEST(HostLayout, OfThisProcessIsStable) {
  EXPECT_FALSE(host_identity().empty());
  EXPECT_EQ(host_identity(), host_identity());
}

using Order = std::vector<int>;  // ranks whose addends a sum holds, in the order of the additions

/// The order in which every host gets every element, with messages between the hosts that hold the orders so far.
std::vector<std::vector<Order>> orders_by_host(const HostLayout& layout, std::size_t count, std::size_t chunk) {
  const auto num_hosts = static_cast<std::size_t>(layout.num_hosts());
  const auto world = static_cast<std::size_t>(layout.first.back());
  const HostRing ring(layout, count, chunk);
  std::vector<std::vector<HostRing::Visit>> visits;
  for (std::size_t host = 0; host < num_hosts; ++host) visits.push_back(ring.visits(static_cast<int>(host)));
  std::vector<std::vector<Order>> results(num_hosts, std::vector<Order>(count));
  std::vector<std::size_t> next(num_hosts);
  std::vector<std::deque<std::pair<HostRing::Visit, std::vector<Order>>>> incoming(num_hosts);
  const auto segment_of = [&](std::size_t element) {
    std::size_t segment = 0;
    while (segment_start(count, segment + 1, world) <= element) ++segment;
    return static_cast<int>(segment);
  };
  bool moved = true;
  while (moved) {
    moved = false;
    for (std::size_t host = 0; host < num_hosts; ++host) {
      if (next[host] == visits[host].size()) continue;
      const HostRing::Visit& visit = visits[host][next[host]];
      std::vector<Order> sums(visit.count);
      if (visit.work != HostRing::Work::begin) {
        if (incoming[host].empty()) continue;
        const auto [sent, content] = incoming[host].front();
        EXPECT_EQ(sent.step + 1, visit.step);
        EXPECT_EQ(sent.first, visit.first);
        EXPECT_EQ(sent.count, visit.count);
        EXPECT_EQ(sent.completes, visit.work == HostRing::Work::copy);
        sums = content;
        incoming[host].pop_front();
      }
      for (std::size_t i = 0; i < visit.count; ++i) {
        const int segment = segment_of(visit.first + i);
        int from = layout.first[host], to = layout.first[host + 1];
        if (visit.work == HostRing::Work::begin) from = segment;
        if (visit.work == HostRing::Work::end) to = segment;
        if (visit.work == HostRing::Work::copy) to = from;
        for (int rank = from; rank < to; ++rank) sums[i].push_back(rank);
        if (visit.completes) results[host][visit.first + i] = sums[i];
      }
      if (visit.goes_on) incoming[(host + 1) % num_hosts].emplace_back(visit, sums);
      ++next[host];
      moved = true;
    }
  }
  for (std::size_t host = 0; host < num_hosts; ++host) {
    EXPECT_EQ(next[host], visits[host].size()) << "host " << host << " waits for ever";
    EXPECT_TRUE(incoming[host].empty());
  }
  return results;
}

TEST(HostRing, EveryHostGetsEveryElementInTheOrderOfTheRing) {
  const std::vector<std::vector<int>> layouts = {{0, 2, 4}, {0, 1, 4}, {0, 3, 4}, {0, 1, 2}, {0, 2, 3, 7}, {0, 1, 2, 3}, {0, 8, 9, 20, 64}};
  for (const auto& first : layouts) {
    const HostLayout layout{first};
    const int world = first.back();
    for (const std::size_t count : {16u * 64u, 2000u, 16385u}) {
      const auto results = orders_by_host(layout, count, 100);
      for (const auto& orders : results)
        for (std::size_t i = 0; i < count; ++i) {
          std::size_t segment = 0;
          while (segment_start(count, segment + 1, static_cast<std::size_t>(world)) <= i) ++segment;
          Order expected(static_cast<std::size_t>(world));
          for (int k = 0; k < world; ++k) expected[static_cast<std::size_t>(k)] = (static_cast<int>(segment) + k) % world;
          ASSERT_EQ(orders[i], expected) << "element " << i << " of " << count << ", " << world << " workers";
        }
    }
  }
}

// Bytes on each wire between hosts: never more than what the ring over workers sends there.
TEST(HostRing, SendsNoMoreThanTheRingOverWorkers) {
  for (const int per_host : {1, 2, 4, 8})
    for (const int num_hosts : {2, 3, 8}) {
      HostLayout layout;
      for (int host = 0; host <= num_hosts; ++host) layout.first.push_back(host * per_host);
      const auto world = static_cast<double>(layout.first.back());
      constexpr std::size_t kCount = 16 * 64 * 100;
      double sent = 0;
      for (const auto& visit : HostRing(layout, kCount, 4096).visits(1)) sent += visit.goes_on ? static_cast<double>(visit.count) : 0;
      EXPECT_LE(sent / kCount, 2 * (world - 1) / world + 1e-3);
      // (2 H - 1 - 1 / L) / H of the buffer, up to the rounding of segments.
      EXPECT_NEAR(sent / kCount, (2.0 * num_hosts - 1 - 1.0 / per_host) / num_hosts, 2e-3);
    }
}

}  // namespace
}  // namespace earshot
