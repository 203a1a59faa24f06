// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/tree_collective.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <filesystem>

#include "sim/base/process/file_limit.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/tree_workers.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kWorkers = 96;  // three levels; 36 is a child of the root and has children

int open_files() {
  int count = 0;
  for ([[maybe_unused]] const auto& file : std::filesystem::directory_iterator("/proc/self/fd")) ++count;
  return count;
}

// The smallest world with a tree, and one whose last segment of the ring is not a whole number of cache lines.
TEST(TreeCollective, SumsEqualASerialSumInTheOrderOfTheRing) {
  for (const int world_size : {65, 96}) {
    const PrivateTestFolder folder;
    const SerialSums<float> floats(world_size, {0, 1, 7, 16383, 16384, 100003});
    const SerialSums<double> doubles(world_size, {5, 8191, 12345});
    WorkerProcesses workers(world_size, [&](int rank) {
      const auto tree = make_zmq_ring(ring_in(folder, rank, world_size));
      return floats.equal_those_of(*tree) && doubles.equal_those_of(*tree);  // and leaves while others may still wait
    });
    workers.expect_all_succeed();
  }
}

TEST(TreeCollective, BroadcastGatherAndBarrier) {
  const PrivateTestFolder folder;
  SharedArray<std::atomic<int>, 1> at_barrier;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    TreeCollective tree(ring_in(folder, rank, kWorkers));
    for (const std::size_t size : {0, 1, (1 << 20) + 1}) {
      const auto byte = [](std::size_t i) { return std::byte(i * 31 >> 3 & 0xFF); };
      std::vector<std::byte> bytes(size, std::byte(1));
      for (std::size_t i = 0; rank == 0 && i < size; ++i) bytes[i] = byte(i);
      tree.broadcast(bytes);
      for (std::size_t i = 0; i < size; ++i)
        if (bytes[i] != byte(i)) return false;
    }
    for (const std::size_t size : {0, 3, 300}) {
      const auto part = [&](int sender) {
        return std::string(size * static_cast<std::size_t>(sender), static_cast<char>('!' + sender % 90));
      };  // rank 0's is empty
      const auto parts = tree.all_gather(part(rank));
      if (static_cast<int>(parts.size()) != kWorkers) return false;
      for (int sender = 0; sender < kWorkers; ++sender)
        if (parts[static_cast<std::size_t>(sender)] != part(sender)) return false;
    }
    std::this_thread::sleep_for(milliseconds(rank % 7 * 30));
    ++at_barrier[0];
    tree.barrier();
    return at_barrier[0] == kWorkers;
  });
  workers.expect_all_succeed();
}

// A worker is often one call ahead, with other sizes and types in turn.
TEST(TreeCollective, CallsInQuickSuccessionDoNotMix) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const auto tree = make_zmq_ring(ring_in(folder, rank, kWorkers));
    for (std::size_t round = 0; round < 12; ++round) {
      const auto value = static_cast<float>(rank + 1) * static_cast<float>(round % 13);
      std::vector<float> floats(round % 3 == 1 ? 20000 : round, value);
      std::vector<double> doubles(round % 3, value);
      tree->all_reduce_sum(floats);
      tree->all_reduce_sum(doubles);
      const double expected = static_cast<double>(kWorkers * (kWorkers + 1) / 2) * static_cast<double>(round % 13);
      for (const float sum : floats)
        if (static_cast<double>(sum) != expected) return false;
      for (const double sum : doubles)
        if (sum != expected) return false;
    }
    return true;
  });
  workers.expect_all_succeed();
}

// 2 x (parent and eight children), and one each to and from the neighbours in the ring.
TEST(TreeCollective, AWorkerHasTwentyConnectionsAtMost) {
  const PrivateTestFolder folder;
  SharedArray<int, 128> connections, files;
  const int world_size = 128;
  WorkerProcesses workers(world_size, [&](int rank) {
    const int before = open_files();
    TreeCollective tree(ring_in(folder, rank, world_size));
    tree.barrier();
    connections[static_cast<std::size_t>(rank)] = tree.num_connections();
    files[static_cast<std::size_t>(rank)] = open_files() - before;
    tree.barrier();
    return true;
  });
  workers.expect_all_succeed();
  int most_files = 0;
  for (std::size_t rank = 0; rank < 128; ++rank) {
    EXPECT_LE(connections[rank], 20) << rank;
    most_files = std::max(most_files, files[rank]);
  }
  // A file for each connection; listeners, dialers, monitors and the context have some of their own.
  EXPECT_LE(most_files, 100);
  RecordProperty("most_files", most_files);
  std::printf("files opened by a worker: %d at most\n", most_files);
}

class LostFromTheTree : public testing::Test {
 protected:
  /// Starts workers that sum `count` floats until that fails, or, where they are between calls, one that then waits in none.  All but the
  /// lost one have to fail with these texts.
  void lose(std::size_t count, int signal, bool between_calls) {
    const PrivateTestFolder folder;
    Arrivals ready;
    WorkerProcesses workers(kWorkers, [&](int rank) {
      RingConfig config = ring_in(folder, rank, kWorkers);
      config.heartbeat = milliseconds(200);
      const auto tree = make_zmq_ring(config);
      std::vector<float> buffer(count);
      tree->all_reduce_sum(buffer);
      ready.arrive();
      if (rank == kLost && between_calls) ::pause();
      return tells(run_error_of([&] {
                     while (true) tree->all_reduce_sum(buffer);
                   }),
                   {fmt::format("worker {}: stopped responding", kLost)});
    });
    ready.wait_for(kWorkers);
    std::this_thread::sleep_for(milliseconds(100));
    ::kill(workers.pid(kLost), signal);
    const auto lost = Clock::now();
    for (int rank = 0; rank < kWorkers; ++rank) {
      if (rank == kLost) continue;
      EXPECT_EQ(workers.wait(rank), 0) << rank;
    }
    EXPECT_LT(seconds_since(lost), 10.0);  // 1 s for a goodbye message, heartbeats for 1 s; the rest for a loaded machine.  Timeout: 20 s
  }
  static constexpr int kLost = 36;
};

TEST_F(LostFromTheTree, KilledWorkerIsNamedByAll) { lose(10, SIGKILL, true); }
TEST_F(LostFromTheTree, KilledWithinASumRoundTheRing) { lose(100000, SIGKILL, false); }
TEST_F(LostFromTheTree, StoppedWorkerIsNamedByAll) { lose(10, SIGSTOP, false); }

// Also of those that are between two calls then.
TEST(TreeCollective, AnotherSizeOnOneWorkerIsAnErrorOnAll) {
  const PrivateTestFolder folder;
  const int odd = 60;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    std::unique_ptr<Collective> tree;
    std::vector<float> buffer(rank == odd ? 8 : 7);
    const auto start = Clock::now();
    const std::string error = run_error_of([&] {  // the others may fail while this one still connects
      tree = make_zmq_ring(ring_in(folder, rank, kWorkers));
      for (int step = 0; rank % 3 == 0 && rank != odd && step < 100; ++step) {
        tree->note_progress();
        std::this_thread::sleep_for(milliseconds(5));
      }
      tree->all_reduce_sum(buffer);
    });
    if (!tells(error, {"worker ", "bytes, but this worker calls all_reduce"})) return false;
    return seconds_since(start) < 15 && (!tree || tells(run_error_of([&] { tree->barrier(); }), {"worker"}));
  });
  workers.expect_all_succeed();
}

TEST(TreeCollective, AnotherCallOnOneWorkerIsAnErrorOnAll) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    std::vector<float> buffer(100000);
    const auto start = Clock::now();
    const std::string error = run_error_of([&] {
      const auto tree = make_zmq_ring(ring_in(folder, rank, kWorkers));
      rank == 5 ? tree->barrier() : tree->all_reduce_sum(buffer);
    });
    return tells(error, {"worker ", "start all workers with the same program and config"}) && seconds_since(start) < 15;
  });
  workers.expect_all_succeed();
}

// One that is slow and says so is waited for, by those too that hear of it over others only.  One that does not is named by all.
TEST(TreeCollective, AWorkerThatGetsOnIsWaitedForForTheTimeoutAnew) {
  const PrivateTestFolder folder;
  const int slow = 50;
  Arrivals started, failed;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    RingConfig config = ring_in(folder, rank, kWorkers);
    config.timeout = milliseconds(3000);
    started.arrive();
    started.wait_for(kWorkers);  // a fork of this program takes a while
    const auto tree = make_zmq_ring(config);
    std::vector<float> buffer(10, 1.0f);
    const auto start = Clock::now();
    while (rank == slow && seconds_since(start) < 4) {
      tree->note_progress();
      std::this_thread::sleep_for(milliseconds(20));
    }
    tree->all_reduce_sum(buffer);
    if (buffer[9] != static_cast<float>(kWorkers)) return false;
    if (rank == slow) {  // alive, its heart beats, but it does not come
      failed.wait_for(kWorkers - 1);
      return true;
    }
    const std::string error = run_error_of([&] { tree->all_reduce_sum(buffer); });
    failed.arrive();
    return tells(error, {fmt::format("worker {}: did not take part in collective call 2 within 3000 ms", slow)});
  });
  workers.expect_all_succeed();
}

TEST(TreeCollective, WorkerThatHasFinishedIsNamedByTheNextCall) {
  const PrivateTestFolder folder;
  const int leaves = 20;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const auto tree = make_zmq_ring(ring_in(folder, rank, kWorkers));
    std::vector<float> buffer(30000, 1.0f);
    if (rank == leaves) {
      tree->all_reduce_sum(buffer);
      return buffer[0] == static_cast<float>(kWorkers);  // leaves in peace
    }
    return tells(run_error_of([&] { tree->all_reduce_sum(buffer), tree->barrier(); }), {fmt::format("worker {}: has finished", leaves)});
  });
  workers.expect_all_succeed();
}

// Preemption asks this after each step: a worker far away in the tree learns it within 0.2 s for each level.
TEST(TreeCollective, CountsThoseThatWait) {
  const PrivateTestFolder folder;
  const int waiting = 60;
  Arrivals informed;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const auto tree = make_zmq_ring(ring_in(folder, rank, kWorkers));
    if (tree->num_waiting() > waiting) return false;  // from now on they tell each other
    if (rank < waiting) {
      tree->barrier();
      return true;
    }
    int count = 0;
    const auto start = Clock::now();
    while (count < waiting && seconds_since(start) < 15) {
      count = tree->num_waiting();
      std::this_thread::sleep_for(milliseconds(10));
    }
    informed.arrive();
    while (seconds_since(start) < 15 && !informed.has(kWorkers - waiting)) {
      if (tree->num_waiting() > waiting) return false;
      std::this_thread::sleep_for(milliseconds(10));
    }
    tree->barrier();
    if (count != waiting) std::fprintf(stderr, "worker %d has heard of %d\n", rank, count);
    return count == waiting;
  });
  workers.expect_all_succeed();
}

TEST(TreeCollective, OverTcpWithKeys) {
  const PrivateTestFolder folder;
  const std::filesystem::path keys = folder.path() / "keys";
  write_curve_keys(keys, make_curve_keys());
  const int world_size = 66, port = free_port();
  const SerialSums<float> sums(world_size, {5, 20000});
  WorkerProcesses workers(world_size, [&](int rank) {
    const auto tree = make_zmq_ring(curve_ring("127.0.0.1", port, rank, world_size, keys));
    return sums.equal_those_of(*tree);
  });
  workers.expect_all_succeed();
}

TEST(TreeCollective, WorldsThatCannotBeAreInputErrors) {
  const PrivateTestFolder folder;
  RingConfig config = ring_in(folder, 0, 65);
  config.network.on_loss = OnLoss::go_on;
  EXPECT_THROW(make_zmq_ring(config), InputError);
  config = ring_in(folder, 0, 1025);
  EXPECT_THROW(make_zmq_ring(config), InputError);
}

TEST(FileLimit, IsRaisedForAsLongAsItIsNeeded) {
  WorkerProcesses worker(2, [](int process) {
    rlimit limit{64, process == 0 ? rlim_t{500} : rlim_t{100}};
    if (::setrlimit(RLIMIT_NOFILE, &limit) != 0) return false;
    const auto soft = [&] { return ::getrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : 0; };
    try {
      const RaisedFileLimit raised(300, "this worker", "raise it");
      if (process == 1 || soft() != 300) return false;
    } catch (const InputError& error) {
      if (process == 0 || !tells(error.what(), {"ulimit -Hn", "100", "this worker needs 300", "raise it"})) return false;
    }
    return soft() == 64;
  });
  worker.expect_all_succeed();
}

TEST(FileLimit, TooFewForRankZeroIsAnInputError) {
  const PrivateTestFolder folder;
  WorkerProcesses worker(1, [&](int rank) {
    const rlimit limit{300, 300};
    if (::setrlimit(RLIMIT_NOFILE, &limit) != 0) return false;
    try {
      make_zmq_ring(ring_in(folder, rank, 100));
    } catch (const InputError& error) {
      return tells(error.what(), {"open files", "300", "rank 0 needs 356", "start fewer workers"});
    }
    return false;
  });
  worker.expect_all_succeed();
}

}  // namespace
}  // namespace earshot
