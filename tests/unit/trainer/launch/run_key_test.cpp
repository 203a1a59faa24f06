// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/run_key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <span>
#include <thread>
#include <vector>

#include "sim/base/errors.h"
#include "tests/support/error_message.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/collective/collective.h"
#include "trainer/launch/launcher_job.h"
#include "trainer/launch/worker_group.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class RunKeyOf : public testing::Test {
 protected:
  RunKeyOf() { ::setenv("TMPDIR", folder_.path().c_str(), 1); }
  ~RunKeyOf() override {
    for (const char* name : {"TMPDIR", "EARSHOT_RANK", "EARSHOT_WORLD_SIZE", "EARSHOT_RENDEZVOUS", "EARSHOT_RUN_ID"}) ::unsetenv(name);
  }
  static void set_worker(int rank, const std::string& rendezvous) {
    ::setenv("EARSHOT_RANK", std::to_string(rank).c_str(), 1);
    ::setenv("EARSHOT_WORLD_SIZE", "2", 1);
    ::setenv("EARSHOT_RENDEZVOUS", rendezvous.c_str(), 1);
    ::setenv("EARSHOT_RUN_ID", "known to all", 1);
  }
  PrivateTestFolder folder_;
};

TEST_F(RunKeyOf, AllWorkersOfARunHaveTheSameAndTheLastOneRemovesIt) {
  std::filesystem::path file;
  {
    const RunKey first("run", "tcp://127.0.0.1:5555");
    file = first.file();
    const CurveKeys keys = read_curve_keys(file);  // which refuses what others can read
    {
      const RunKey second("run", "tcp://127.0.0.1:5555");
      EXPECT_EQ(second.file(), file);
      EXPECT_EQ(read_curve_keys(second.file()).secret_key, keys.secret_key);
    }
    EXPECT_TRUE(std::filesystem::exists(file));
    const RunKey other("another", "tcp://127.0.0.1:5555");
    EXPECT_NE(read_curve_keys(other.file()).secret_key, keys.secret_key);
  }
  EXPECT_FALSE(std::filesystem::exists(file.parent_path()));
}

TEST_F(RunKeyOf, ManyThatComeAtOnceAgree) {
  for (int round = 0; round < 20; ++round) {
    SharedArray<char, 8 * 64> seen;
    SharedArray<std::atomic<int>, 2> ready_workers;
    WorkerProcesses workers(8, [&](int rank) {
      const RunKey key("run", "tcp://[::1]:" + std::to_string(round + 1));
      read_curve_keys(key.file()).public_key.copy(&seen[static_cast<std::size_t>(rank) * 64], 40);
      ++ready_workers[0];
      return wait_until([&] { return ready_workers[0] >= 8; }, 30);
    });
    workers.expect_all_succeed();
    for (std::size_t rank = 1; rank < 8; ++rank)
      EXPECT_EQ(std::string(&seen[rank * 64], 40), std::string(&seen[0], 40)) << "round " << round << ", worker " << rank;
  }
}

TEST_F(RunKeyOf, AFolderOpenToOthersIsRefused) {
  std::filesystem::path parent;
  {
    const RunKey key("run", "tcp://127.0.0.1:5555");
    parent = key.file().parent_path();
  }
  std::filesystem::create_directory(parent);
  ASSERT_EQ(::chmod(parent.c_str(), 0777), 0);
  EXPECT_THAT(error_message([] { const RunKey key("run", "tcp://127.0.0.1:5555"); }), HasSubstr("is not a folder of this user alone"));
}

// Whoever knows the run id, the port and the number of workers, but cannot read the key, takes no rank.
TEST_F(RunKeyOf, AnUnknownPeerOnTheLoopbackInterfaceTakesNoRank) {
  const std::string rendezvous = "tcp://127.0.0.1:29431";
  WorkerProcesses workers(3, [&](int number) {
    if (number == 2) {  // from the first moment on
      RingConfig unknown_peer;
      unknown_peer.identity = {1, 2};
      unknown_peer.rendezvous = rendezvous;
      unknown_peer.run_id = "known to all";
      unknown_peer.timeout = std::chrono::milliseconds(2500);
      return error_message([&] { make_zmq_ring(unknown_peer); }) != "no error";
    }
    if (number == 1) std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    set_worker(number, rendezvous);
    const auto worker = worker_from_environment();
    if (!worker || !worker->run_key || worker->ring.network.curve_key_file != worker->run_key->file()) return false;
    const auto ring = make_zmq_ring(worker->ring);
    std::vector<double> sum{number + 1.0};
    ring->all_reduce_sum(std::span<double>(sum));
    return sum[0] == 3.0;
  });
  workers.expect_all_succeed();
}

TEST_F(RunKeyOf, OnlyTheLoopbackInterfaceWithoutOtherKeysNeedsIt) {
  set_worker(0, "tcp://127.0.0.1:5555");
  EXPECT_TRUE(worker_from_environment()->run_key);
  NetworkConfig network;
  network.insecure = true;
  EXPECT_FALSE(worker_from_environment(network)->run_key);
  set_worker(0, "ipc://" + (folder_.path() / "meet").string());
  EXPECT_FALSE(worker_from_environment()->run_key);
}

TEST(LauncherJob, IsTheOutermostName) {
  EXPECT_EQ(launcher_job(Variables{}), "");
  EXPECT_EQ(launcher_job(Variables{{"EARSHOT_RUN_ID", "a"}}), "EARSHOT_RUN_ID a");
  EXPECT_EQ(launcher_job(Variables{{"EARSHOT_RUN_ID", "a"}, {"SLURM_JOB_ID", "12"}, {"SLURM_RESTART_COUNT", "1"}}), "SLURM_JOB_ID 12");
  EXPECT_EQ(launcher_job(Variables{{"EARSHOT_RUN_ID", "a"}, {"PMIX_NAMESPACE", "7"}}), "EARSHOT_RUN_ID a") << "another one at each mpirun";
  EXPECT_EQ(launcher_job(Variables{{"TORCHELASTIC_RUN_ID", "b"}, {"TORCHELASTIC_RESTART_COUNT", "3"}}), "TORCHELASTIC_RUN_ID b");
}

}  // namespace
}  // namespace earshot
