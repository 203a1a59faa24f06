// SPDX-License-Identifier: Apache-2.0
// The calls of a Collective over MPI: ranks started by mpirun, more of them than cores.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "sim/base/files.h"
#include "tests/support/seconds_since.h"
#include "tests/support/workers/slurm_node.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/launch/transport.h"

namespace earshot {
namespace {

using testing::HasSubstr;

struct MpiJob {
  int exit_code = -1, as_expected = 0;
  std::string text;
  double seconds = 0;
};

class MpiCollective : public testing::Test {
 protected:
  void SetUp() override {
    if (!built_transports().mpi) GTEST_SKIP() << "this build has no MPI (libopenmpi-dev was missing at configure time)";
    if (!has_program("mpirun")) GTEST_SKIP() << "mpirun is not installed (openmpi-bin)";
    for (const char* name : {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"}) ::setenv(name, "1", 1);
  }
  static MpiJob mpirun(int ranks, const std::string& scenario, const std::string& options = "") {
    const PrivateTestFolder folder;
    const std::filesystem::path rank_program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "mpi_rank";
    const std::string output = folder.path() / "output";
    const auto start = std::chrono::steady_clock::now();
    const int status = std::system(fmt::format("timeout 900 mpirun -n {} --oversubscribe {} {} {} {} >{} 2>&1 </dev/null", ranks, options,
                                               rank_program.string(), scenario, folder.path().string(), output)
                                       .c_str());
    MpiJob job{WIFEXITED(status) ? WEXITSTATUS(status) : -1, 0, read_file(output), seconds_since(start)};
    for (int rank = 0; rank < ranks; ++rank)
      job.as_expected += std::filesystem::exists(folder.path() / ("as_expected." + std::to_string(rank))) ? 1 : 0;
    return job;
  }
  static void expect_succeeds(int ranks, const std::string& scenario) {
    const MpiJob job = mpirun(ranks, scenario);
    EXPECT_EQ(job.exit_code, 0) << job.text;
    EXPECT_EQ(job.as_expected, ranks) << job.text;
    std::printf("%s of %d ranks: %.1f s\n", scenario.c_str(), ranks, job.seconds);
  }
  /// All ranks see what they have to see; then the launcher ends the job.
  static void expect_ends(int ranks, const std::string& scenario) {
    const MpiJob job = mpirun(ranks, scenario);
    EXPECT_NE(job.exit_code, 0) << job.text;
    EXPECT_EQ(job.as_expected, ranks) << job.text;
  }
};

TEST_F(MpiCollective, SumsEqualASerialSumInTheOrderOfTheRing) {
  for (const int ranks : {2, 3, 16}) expect_succeeds(ranks, "sums");
}
TEST_F(MpiCollective, BroadcastGatherAndBarrier) { expect_succeeds(9, "messages"); }
TEST_F(MpiCollective, CallsInQuickSuccessionDoNotMix) { expect_succeeds(9, "succession"); }
TEST_F(MpiCollective, AnotherSizeOnOneWorkerIsAnErrorOnAll) { expect_ends(7, "other_size"); }
TEST_F(MpiCollective, AnotherCallOnOneWorkerIsAnErrorOnAll) { expect_ends(7, "other_call"); }
TEST_F(MpiCollective, WorkerThatHasFinishedIsNamedByTheNextCall) { expect_ends(7, "finished"); }
TEST_F(MpiCollective, CountsThoseThatWait) { expect_succeeds(8, "waiting"); }
TEST_F(MpiCollective, AWorkerThatGetsOnIsWaitedForForTheTimeoutAnew) { expect_ends(6, "slow"); }

TEST_F(MpiCollective, AKilledWorkerEndsTheJob) {
  const MpiJob job = mpirun(6, "killed");
  EXPECT_NE(job.exit_code, 0);
  EXPECT_LT(job.seconds, 60);  // the calls would wait for 120 s
  EXPECT_THAT(job.text, HasSubstr("rank 5"));
}

TEST_F(MpiCollective, WithoutALauncherIsAnInputError) {
  const PrivateTestFolder folder;
  const std::filesystem::path rank_program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "mpi_rank";
  const std::string output = folder.path() / "output";
  // As srun without PMIx starts them: each is a world of its own for MPI.
  const int status =
      std::system(fmt::format("env EARSHOT_RANK=1 EARSHOT_WORLD_SIZE=2 EARSHOT_RENDEZVOUS=tcp://127.0.0.1:1 EARSHOT_RUN_ID=a "
                              "timeout 60 {} sums {} >{} 2>&1",
                              rank_program.string(), folder.path().string(), output)
                      .c_str());
  EXPECT_NE(status, 0);
  EXPECT_THAT(read_file(output), testing::AllOf(HasSubstr("MPI says rank 0 of 1, the launcher 1 of 2"), HasSubstr("srun --mpi=pmix")));
}

TEST_F(MpiCollective, SumsOf128Ranks) { expect_succeeds(128, "sums"); }
TEST_F(MpiCollective, SumsOf512Ranks) {
  if (std::thread::hardware_concurrency() < 16) GTEST_SKIP() << "512 ranks need a machine of 16 cores: on two they do not meet in 500 s";
  expect_succeeds(512, "sums");
}
TEST_F(MpiCollective, ErrorsOf128Ranks) {
  expect_ends(128, "other_size");
  expect_succeeds(128, "waiting");
  const MpiJob job = mpirun(128, "killed");
  EXPECT_NE(job.exit_code, 0);
  EXPECT_LT(job.seconds, 100);
}

}  // namespace
}  // namespace earshot
