// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/collective.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <thread>
#include <tuple>
#include <zmq.hpp>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/error_message.h"
#include "tests/support/seconds_since.h"
#include "tests/support/workers/summed_addends.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/collective/shared_memory.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

/// Workers that send their sums, and workers that share memory: the same tests, the same bits.
class RingOf : public testing::TestWithParam<std::tuple<int, bool>> {
 protected:
  static int world_size() { return std::get<0>(GetParam()); }
  static RingConfig config(const PrivateTestFolder& folder, int rank) {
    RingConfig config = ring_in(folder, rank, world_size());
    config.network.shared_memory = std::get<1>(GetParam());
    return config;
  }
};
INSTANTIATE_TEST_SUITE_P(Workers, RingOf, testing::Combine(testing::Values(2, 3, 4), testing::Bool()), [](const auto& test) {
  return fmt::format("{}{}", std::get<0>(test.param), std::get<1>(test.param) ? "Sharing" : "Sending");
});

TEST_P(RingOf, SumsEqualTheReferenceInTheStatedOrder) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(world_size(), [&](int rank) {
    const auto ring = make_zmq_ring(config(folder, rank));
    // Around the small/ring border (16384 floats), around one chunk (262144 floats), and a gradient of 20 MB.
    for (const std::size_t count : {0, 1, 7, 16383, 16384, 16385, 262143, 262144, 262145, 524289, 5000000})
      if (!sums_are_right<float>(*ring, count)) return false;
    for (const std::size_t count : {0, 1, 7, 8191, 8192, 131071, 131072, 131073, 700001})
      if (!sums_are_right<double>(*ring, count)) return false;
    return true;
  });
  workers.expect_all_succeed();
}

TEST_P(RingOf, BitsAreEqualOnAllWorkersAndFromRunToRun) {
  const PrivateTestFolder folder;
  SharedArray<std::uint64_t, 8> hashes;
  WorkerProcesses workers(world_size(), [&](int rank) {
    std::uint64_t hash = 0;
    for (int run = 0; run < 2; ++run) {
      const auto ring = make_zmq_ring(config(folder, rank));
      std::vector<float> buffer(1000003);
      for (std::size_t i = 0; i < buffer.size(); ++i) buffer[i] = addend<float>(rank, i);
      ring->all_reduce_sum(buffer);
      const std::uint64_t now = hash64(std::as_bytes(std::span(buffer)));
      if (run == 1 && now != hash) return false;
      hash = now;
    }
    hashes[static_cast<std::size_t>(rank)] = hash;
    return true;
  });
  workers.expect_all_succeed();
  for (int rank = 1; rank < world_size(); ++rank) EXPECT_EQ(hashes[static_cast<std::size_t>(rank)], hashes[0]);
}

// libzmq may still be sending a buffer when the sum is complete; a call that returned then would send what the caller writes next.
TEST_P(RingOf, CallerMayOverwriteTheBufferAtOnce) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(world_size(), [&](int rank) {
    const auto ring = make_zmq_ring(config(folder, rank));
    std::vector<float> buffer(1u << 20);
    for (int round = 0; round < 12; ++round) {
      std::fill(buffer.begin(), buffer.end(), static_cast<float>(rank + round));
      ring->all_reduce_sum(buffer);
      const auto expected = static_cast<float>(world_size() * (world_size() - 1) / 2 + world_size() * round);
      for (const float value : buffer)
        if (value != expected) return false;
      std::fill(buffer.begin(), buffer.end(), -1e9f);
    }
    return true;
  });
  workers.expect_all_succeed();
}

TEST_P(RingOf, BroadcastGatherAndBarrier) {
  const PrivateTestFolder folder;
  SharedArray<std::atomic<int>, 1> arrived;
  WorkerProcesses workers(world_size(), [&](int rank) {
    const auto ring = make_zmq_ring(config(folder, rank));
    for (const std::size_t size : {0, 1, 1 << 20, (1 << 20) + 1, 5000000}) {
      std::vector<std::byte> bytes(size, std::byte(rank + 1));
      for (std::size_t i = 0; rank == 0 && i < size; ++i) bytes[i] = std::byte(i * 31 >> 3 & 0xFF);
      ring->broadcast(bytes);
      for (std::size_t i = 0; i < size; ++i)
        if (bytes[i] != std::byte(i * 31 >> 3 & 0xFF)) return false;
    }
    for (const std::size_t size : {0, 3, 3000000}) {
      const auto part = [&](int sender) {
        return std::string(size * static_cast<std::size_t>(sender), static_cast<char>('a' + sender));
      };  // rank 0's is empty
      const auto parts = ring->all_gather(part(rank));
      if (static_cast<int>(parts.size()) != world_size()) return false;
      for (int sender = 0; sender < world_size(); ++sender)
        if (parts[static_cast<std::size_t>(sender)] != part(sender)) return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(30 * rank));
    ++arrived[0];
    ring->barrier();
    return arrived[0] == world_size();
  });
  workers.expect_all_succeed();
}

// Over tcp the workers tell each other where they are, and share memory on one host too.
TEST(Collective, EightWorkersAndTcp) {
  for (const bool shared_memory : {false, true}) {
    SharedArray<int, 1> port;
    {
      zmq::context_t context;
      zmq::socket_t probe(context, zmq::socket_type::router);
      probe.bind("tcp://127.0.0.1:*");
      const std::string endpoint = probe.get(zmq::sockopt::last_endpoint);
      port[0] = std::stoi(endpoint.substr(endpoint.rfind(':') + 1));
    }
    WorkerProcesses workers(8, [&](int rank) {
      RingConfig config;
      config.identity = {rank, 8};
      config.rendezvous = "tcp://127.0.0.1:" + std::to_string(port[0]);
      config.run_id = "eight";
      config.network.shared_memory = shared_memory;
      ZmqRing ring(config);
      return ring.shares_memory() == shared_memory && sums_are_right<float>(ring, 5) && sums_are_right<float>(ring, 100001) &&
             sums_are_right<double>(ring, 9001);
    });
    workers.expect_all_succeed();
  }
}

// A worker that is to send its sums counts as a host of its own: the others share memory, and one of them sends for all.
TEST(Collective, WorkersThatSendAndWorkersThatShareMemorySumAlike) {
  for (const int sender : {0, 1, 5}) {  // between two of the others there is no memory to share: their ranks do not follow each other
    const PrivateTestFolder folder;
    WorkerProcesses workers(6, [&](int rank) {
      RingConfig config = ring_in(folder, rank, 6);
      config.network.shared_memory = rank != sender;
      ZmqRing ring(config);
      if (ring.shares_memory() || ring.shares_memory_per_host() != (sender != 1)) return false;
      return sums_are_right<float>(ring, 5) && sums_are_right<float>(ring, 16384) && sums_are_right<float>(ring, 400001) &&
             sums_are_right<double>(ring, 100001);
    });
    workers.expect_all_succeed();
  }
}

TEST(Collective, OneWorkerAloneChangesNothing) {
  const auto single = make_single_worker();
  std::vector<float> buffer{1, 2, 3};
  single->all_reduce_sum(buffer);
  single->barrier();
  EXPECT_EQ(buffer, (std::vector<float>{1, 2, 3}));
  EXPECT_EQ(single->all_gather("x"), std::vector<std::string>{"x"});
  EXPECT_EQ(single->identity().world_size, 1);
  RingConfig config;
  EXPECT_EQ(make_zmq_ring(config)->identity().world_size, 1);
}

/// Runs `call`; true if it throws a RunError that contains each of `texts`.
bool fails_with(const std::function<void()>& call, const std::vector<std::string>& texts) {
  try {
    call();
  } catch (const RunError& error) {
    for (const auto& text : texts) {
      if (std::string(error.what()).find(text) != std::string::npos) continue;
      std::fprintf(stderr, "'%s' lacks '%s'\n", error.what(), text.c_str());
      return false;
    }
    return true;
  }
  std::fprintf(stderr, "no error\n");
  return false;
}

TEST_P(RingOf, AnotherSizeOnOneWorkerIsAnErrorOnAll) {
  // Small and small, ring and ring, small and ring, nothing and something.
  using Sizes = std::pair<std::size_t, std::size_t>;
  const Sizes sizes[] = {{7, 8}, {1000000, 1000001}, {100, 1000000}, {1000000, 100}, {0, 1}};
  for (const auto& [usual, odd] : sizes) {
    const PrivateTestFolder folder;
    WorkerProcesses workers(world_size(), [&](int rank) {
      std::unique_ptr<Collective> ring;
      std::vector<float> buffer(rank == 1 ? odd : usual);
      const auto connect_and_sum = [&] {  // the others may fail while we still connect
        ring = make_zmq_ring(config(folder, rank));
        ring->all_reduce_sum(buffer);
      };
      return fails_with(connect_and_sum, {"worker "}) &&
             (!ring || fails_with([&] { ring->barrier(); }, {"already stopped"}));  // and it stays that way
    });
    const auto start = Clock::now();
    workers.expect_all_succeed();
    EXPECT_LT(seconds_since(start), 10.0);  // by the error, not by the timeout of 20 s
  }
}

TEST_P(RingOf, AnotherCallOnOneWorkerIsAnErrorOnAll) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(world_size(), [&](int rank) {
    std::vector<float> buffer(100000);
    const auto connect_and_call = [&] {
      const auto ring = make_zmq_ring(config(folder, rank));
      rank == 1 ? ring->barrier() : ring->all_reduce_sum(buffer);
    };
    return fails_with(connect_and_call, {"worker "});
  });
  workers.expect_all_succeed();
}

// Whoever receives what belongs to another call says which call and how large: the user then knows to look at programs and configs.
TEST(Collective, ASumOfAnotherSizeIsNamedWithBothSizes) {
  for (const int world_size : {2, 3, 4}) {
    const PrivateTestFolder folder;
    SharedArray<std::atomic<int>, 2> said;  // number of messages that named both sizes, and number with another complaint
    WorkerProcesses workers(world_size, [&](int rank) {
      RingConfig config = ring_in(folder, rank, world_size);
      config.network.shared_memory = false;
      std::vector<float> buffer(rank == 1 ? 200000 : 100000);
      const std::string text = error_message([&] { make_zmq_ring(config)->all_reduce_sum(buffer); });
      const auto has = [&](const char* part) { return text.find(part) != std::string::npos; };
      said[0] += has("with 800000 bytes") && has("with 400000 bytes");
      said[1] += has("wrong part of the buffer");
      return has("worker ");
    });
    workers.expect_all_succeed();
    EXPECT_GE(said[0], 1) << world_size;
    EXPECT_EQ(said[1], 0) << world_size;
  }
}

TEST(Collective, KilledWorkerIsNamedWithinSeconds) {
  for (const auto& [within_a_sum, shared_memory] : {std::pair(false, false), {true, false}, {false, true}, {true, true}}) {
    const PrivateTestFolder folder;
    SharedArray<std::atomic<int>, 1> ready;
    WorkerProcesses workers(3, [&, within_a_sum = within_a_sum, shared_memory = shared_memory](int rank) {
      RingConfig config = ring_in(folder, rank, 3);
      config.network.shared_memory = shared_memory;
      const auto ring = make_zmq_ring(config);
      std::vector<float> buffer(within_a_sum ? 5000000 : 10);
      ++ready[0];
      if (rank == 1 && !within_a_sum) ::pause();
      const auto start = Clock::now();
      return fails_with(
                 [&] {
                   while (true) ring->all_reduce_sum(buffer);
                 },
                 {"worker 1"}) &&
             seconds_since(start) < 10;
    });
    ASSERT_TRUE(workers.wait_until([&] { return ready[0] >= 3; }));
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    ::kill(workers.pid(1), SIGKILL);
    const auto killed = Clock::now();
    EXPECT_EQ(workers.wait(0), 0);
    EXPECT_EQ(workers.wait(2), 0);
    EXPECT_LT(seconds_since(killed), 5.0);  // 0.3 s of shutdown grace period, the rest for a loaded machine
  }
}

TEST(Collective, StoppedWorkerIsNamedAfterFourHeartbeats) {
  const PrivateTestFolder folder;
  SharedArray<std::atomic<int>, 1> ready;
  WorkerProcesses workers(3, [&](int rank) {
    RingConfig config = ring_in(folder, rank, 3);
    config.heartbeat = std::chrono::milliseconds(200);
    const auto ring = make_zmq_ring(config);
    std::vector<float> buffer(1000000);
    ++ready[0];
    return fails_with(
        [&] {
          while (true) ring->all_reduce_sum(buffer);
        },
        {"worker 1"});
  });
  ASSERT_TRUE(workers.wait_until([&] { return ready[0] >= 3; }));
  ::kill(workers.pid(1), SIGSTOP);
  const auto stopped = Clock::now();
  EXPECT_EQ(workers.wait(0), 0);
  EXPECT_EQ(workers.wait(2), 0);
  EXPECT_LT(seconds_since(stopped), 5.0);  // 4 x 0.2 s, one interval until the next beat, 0.3 s of grace
}

TEST(Collective, BusyWorkerIsNamedAfterTheTimeout) {
  const PrivateTestFolder folders[3];
  const std::size_t counts[3] = {10, 1000000, 1000000};  // one hop, ring, shared memory
  WorkerProcesses workers(6, [&](int process) {
    const int rank = process % 2;
    RingConfig config = ring_in(folders[process / 2], rank, 2);
    config.network.shared_memory = process / 2 == 2;
    config.timeout = std::chrono::milliseconds(1000);
    const auto ring = make_zmq_ring(config);
    std::vector<float> buffer(counts[process / 2]);
    if (rank == 1) {  // alive, its heart beats, but it does not come
      std::this_thread::sleep_for(std::chrono::milliseconds(1600));
      return fails_with([&] { ring->all_reduce_sum(buffer); }, {"worker 0"});
    }
    const auto start = Clock::now();
    return fails_with([&] { ring->all_reduce_sum(buffer); }, {"worker 1", "1000 ms"}) && seconds_since(start) > 0.9;
  });
  workers.expect_all_succeed();
}

TEST_P(RingOf, SharesMemoryWhereItIsTold) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(world_size(), [&](int rank) {
    ZmqRing ring(config(folder, rank));
    return ring.shares_memory() == std::get<1>(GetParam());
  });
  workers.expect_all_succeed();
}

// Sums follow each other without a pause, so a worker is often one call ahead, with other sizes and types in turn.
TEST_P(RingOf, SumsInQuickSuccessionDoNotMix) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(world_size(), [&](int rank) {
    const auto ring = make_zmq_ring(config(folder, rank));
    for (std::size_t round = 0; round < 600; ++round) {
      const auto value = static_cast<float>(rank + 1) * static_cast<float>(round % 97);
      std::vector<float> floats(round % 5 * 9001 % 40000, value);
      std::vector<double> doubles(round % 3, value);
      ring->all_reduce_sum(floats);
      ring->all_reduce_sum(doubles);
      const double expected = static_cast<double>(world_size() * (world_size() + 1) / 2) * static_cast<double>(round % 97);
      for (const float sum : floats)
        if (static_cast<double>(sum) != expected) return false;
      for (const double sum : doubles)
        if (sum != expected) return false;
      if (round % 100 == 0) ring->barrier();
    }
    return true;
  });
  workers.expect_all_succeed();
}

TEST(SharedMemory, IsZeroAndTheSameForWhoeverOpensIt) {
  const SharedMemory made = SharedMemory::create(10000);
  const SharedMemory opened = SharedMemory::open(made.path(), 10000);
  EXPECT_NE(made.bytes().data(), opened.bytes().data());
  EXPECT_TRUE(std::ranges::all_of(opened.bytes(), [](std::byte byte) { return byte == std::byte(0); }));
  made.bytes()[9999] = std::byte(7);
  EXPECT_EQ(opened.bytes()[9999], std::byte(7));
  EXPECT_THROW(SharedMemory::open(made.path(), 10001), RunError);
  EXPECT_THROW(SharedMemory::open("/proc/self/fd/987654", 10000), RunError);
}

TEST(SharedMemory, SaysWhenItCannotTakeThem) {
  WorkerProcesses worker(1, [](int) {
    const rlimit limit{4096, 4096};
    ::signal(SIGXFSZ, SIG_IGN);
    return ::setrlimit(RLIMIT_FSIZE, &limit) == 0 && fails_with([] { SharedMemory::create(10000); }, {"cannot take 10000 bytes"});
  });
  worker.expect_all_succeed();
}

TEST(Collective, WorkerThatHasFinishedIsNamedByTheNextCall) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(3, [&](int rank) {
    const auto ring = make_zmq_ring(ring_in(folder, rank, 3));
    std::vector<float> buffer(300000, 1.0f);
    if (rank == 1) {
      ring->all_reduce_sum(buffer);
      return buffer[0] == 3.0f;  // leaves in peace, maybe before the others have their sums
    }
    // A slow worker may learn it while it still collects its sum: the faster one is at the barrier by then and stops the run.
    return fails_with([&] { ring->all_reduce_sum(buffer), ring->barrier(); }, {"worker 1", "has finished"});
  });
  workers.expect_all_succeed();
}

TEST(Collective, PeerThatBreaksTheProtocolIsNamed) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(2, [&](int rank) {
    const RingConfig config = ring_in(folder, rank, 2);
    if (rank == 0) return fails_with([&] { make_zmq_ring(config); }, {"worker 1", "breaks the protocol"});
    // A worker by its introduction, a babbler from then on.
    zmq::context_t context;
    zmq::socket_t control(context, zmq::socket_type::router), bulk(context, zmq::socket_type::router),
        out(context, zmq::socket_type::dealer);
    control.bind(listening_address(config, "control"));
    bulk.bind(listening_address(config, "bulk"));
    const PeerTable table = meet(context, config, listening_address(config, "control"), listening_address(config, "bulk"));
    out.set(zmq::sockopt::routing_id, "E" + hex64(hash64(config.run_id, table.run_key)) + ".1.00000000");
    out.connect(table.control_endpoints[0]);
    out.send(zmq::str_buffer("not a header"), zmq::send_flags::sndmore);
    out.send(zmq::str_buffer("at all"), zmq::send_flags::none);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    return true;
  });
  workers.expect_all_succeed();
}

}  // namespace
}  // namespace earshot
