// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/workers/tree_workers.h"

// Many workers, each a process, all on this host.
namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

class ManyWorkers : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Of, ManyWorkers, testing::Values(128, 512), [](const auto& test) { return std::to_string(test.param); });

RingConfig config_of(const PrivateTestFolder& folder, int rank) {
  RingConfig config = ring_in(folder, rank, ManyWorkers::GetParam());
  config.timeout = std::chrono::seconds(120);
  config.heartbeat = std::chrono::seconds(2);  // hundreds of processes to a core
  return config;
}

TEST_P(ManyWorkers, SumAsASerialComputation) {
  const int world_size = GetParam();
  const PrivateTestFolder folder;
  const SerialSums<float> floats(world_size, {7, 16383, 16384, 300007});
  const SerialSums<double> doubles(world_size, {5});
  Arrivals started;
  SharedArray<double, 8> seconds;
  SharedArray<std::atomic<int>, 1> connections;
  WorkerProcesses workers(world_size, [&](int rank) {
    ::alarm(1200);
    started.arrive();
    started.wait_for(world_size);
    const auto start = Clock::now();
    TreeCollective tree(config_of(folder, rank));
    if (rank == 0) seconds[0] = seconds_since(start);
    for (int most = connections[0]; most < tree.num_connections() && !connections[0].compare_exchange_weak(most, tree.num_connections());) {
    }
    if (!floats.equal_those_of(tree) || !doubles.equal_those_of(tree)) return false;
    std::vector<float> few(10), many(1000000);
    const auto seconds_of = [&](int repetitions, auto&& call) {
      tree.barrier();
      const auto began = Clock::now();
      for (int i = 0; i < repetitions; ++i) call();
      return seconds_since(began) / repetitions;
    };
    const double barrier_s = seconds_of(10, [&] { tree.barrier(); }), few_s = seconds_of(10, [&] { tree.all_reduce_sum(few); }),
                 many_s = seconds_of(1, [&] { tree.all_reduce_sum(many); });
    if (rank == 0) seconds[1] = barrier_s, seconds[2] = few_s, seconds[3] = many_s;
    const auto texts = tree.all_gather(std::to_string(rank));
    for (int sender = 0; sender < world_size; ++sender)
      if (texts[static_cast<std::size_t>(sender)] != std::to_string(sender)) return false;
    return true;
  });
  workers.expect_all_succeed();
  EXPECT_LE(connections[0], 20);
  std::printf("%d workers, %d connections at most: meet %.2f s, barrier %.1f ms, sum of 40 bytes %.1f ms, of 4 MB %.0f ms\n", world_size,
              connections[0].load(), seconds[0], 1e3 * seconds[1], 1e3 * seconds[2], 1e3 * seconds[3]);
}

TEST_P(ManyWorkers, OneKilledIsNamedByAll) {
  const int world_size = GetParam(), lost = world_size / 3;
  const PrivateTestFolder folder;
  Arrivals started, ready;
  WorkerProcesses workers(world_size, [&](int rank) {
    ::alarm(600);
    started.arrive();
    started.wait_for(world_size);
    const auto tree = make_zmq_ring(config_of(folder, rank));
    std::vector<float> buffer(10);
    tree->all_reduce_sum(buffer);
    ready.arrive();
    return tells(run_error_of([&] {
                   while (true) tree->all_reduce_sum(buffer);
                 }),
                 {fmt::format("worker {}: stopped responding", lost)});
  });
  ready.wait_for(world_size);
  ::kill(workers.pid(lost), SIGKILL);
  const auto killed = Clock::now();
  for (int rank = 0; rank < world_size; ++rank) {
    if (rank == lost) continue;
    EXPECT_EQ(workers.wait(rank), 0) << rank;
  }
  std::printf("%d workers: all have ended %.2f s after one was killed\n", world_size, seconds_since(killed));
  EXPECT_LT(seconds_since(killed), 60.0);  // half of the timeout
}

}  // namespace
}  // namespace earshot
