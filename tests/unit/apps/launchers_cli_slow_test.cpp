// SPDX-License-Identifier: Apache-2.0
// `earshot train` started by the launchers that are installed here, and on two hosts: each gives the bits of `--workers 2`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "tests/support/programs/launchers_cli.h"
#include "tests/support/workers/host_namespaces.h"
#include "tests/support/workers/slurm_node.h"

namespace earshot {
namespace {

using testing::HasSubstr;

TEST_F(LaunchersCli, TwoHostsWithKeysGiveTheBitsOfOne) {
  const HostNamespaces hosts(2);
  if (!hosts.missing().empty()) GTEST_SKIP() << hosts.missing();
  expect_done("keys " + path("keys"));
  const auto worker = [&](int rank) {
    return hosts.on(rank) + "env EARSHOT_RANK=" + std::to_string(rank) +
           " EARSHOT_WORLD_SIZE=2 EARSHOT_RUN_ID=a EARSHOT_RENDEZVOUS=tcp://" + HostNamespaces::address(0) + ":29400 " +
           earshot_program().string() + " train " + config_ + " out=" + path("two_hosts");
  };
  const auto two_workers = [&](const std::string& options) { return worker(0) + options + " & " + worker(1) + options + " && wait $!"; };
  const Outcome open = shell(worker(0));
  EXPECT_EQ(open.exit_code, 2);
  EXPECT_THAT(open.text, testing::AllOf(HasSubstr("earshot keys"), HasSubstr("--insecure-network")));
  expect_done_by(two_workers(" network.curve_key_file=" + path("keys")));
  EXPECT_EQ(bits_of("two_hosts"), bits_of_our_spawn());
}

TEST_F(LaunchersCli, MpirunGivesTheBitsOfOurSpawn) {
  if (!has_program("mpirun")) GTEST_SKIP() << "mpirun is not installed (openmpi-bin)";
  const std::string start = "EARSHOT_MPIRUN=--oversubscribe " + launch("mpirun.sh") + " 2 " + config_ + " out=" + path("mpirun");
  const Outcome refused = shell(start + " --workers 3");
  EXPECT_EQ(refused.exit_code, 2) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("Open MPI has already started 2 workers"));
  const Outcome done = shell(start);
  EXPECT_EQ(done.exit_code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("2 workers started by Open MPI, rendezvous at ipc://"));
  EXPECT_EQ(bits_of("mpirun"), bits_of_our_spawn());
}

TEST_F(LaunchersCli, TorchrunGivesTheBitsOfOurSpawn) {
  if (!has_program("torchrun")) GTEST_SKIP() << "torchrun is not installed (python3-torch)";
  expect_done_by(launch("torchrun.sh") + " 2 " + config_ + " out=" + path("torchrun"));
  EXPECT_EQ(bits_of("torchrun"), bits_of_our_spawn());
}

TEST_F(LaunchersCli, SlurmGivesTheBitsOfOurSpawnAcrossARequeue) {
  const SlurmNode slurm(folder_.path() / "slurm");
  if (!slurm.missing().empty()) GTEST_SKIP() << slurm.missing();
  const Outcome refused = shell("srun -n2 " + earshot_program().string() + " train " + config_ + " --workers 3 out=" + path("srun"));
  EXPECT_EQ(refused.exit_code, 2) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("Slurm has already started 2 workers"));

  // Asked by USR1 after a few updates; the job writes a checkpoint, queues itself again and goes on.
  ::setenv("EARSHOT_OUT", path("slurm_run").c_str(), 1);
  const std::string steps = " total_steps=800";
  const Outcome queued =
      shell("sbatch --parsable -n 2 -o " + path("slurm.log") + " " + launch("slurm.sbatch") + " " + config_ + steps + " | tail -n 1");
  ASSERT_EQ(queued.exit_code, 0) << queued.text;
  const std::string job = std::to_string(std::stoi(queued.text));
  const auto log = [&] { return std::filesystem::exists(path("slurm.log")) ? read_file(path("slurm.log")) : std::string("no log"); };
  const auto state_is = [&](const std::string& state) {
    return shell("squeue -h -t all -j " + job + " -o %T").text.find(state) != std::string::npos;
  };
  ASSERT_TRUE(wait_until([&] { return std::filesystem::exists(path("slurm_run/checkpoints/update_000003.ckpt")); }, 60)) << log();
  expect_done_by("scancel --batch --signal=USR1 " + job);
  ASSERT_TRUE(wait_until([&] { return state_is("PENDING"); }, 60)) << log();
  const std::uint64_t half_way = bits_of("slurm_run");
  // Slurm lets a queued job wait for two minutes, and sets that time shortly after it shows the job as pending: asked for until it holds.
  const auto completed = [&] {
    if (state_is("PENDING")) static_cast<void>(shell("scontrol update jobid=" + job + " StartTime=now"));
    return state_is("COMPLETED");
  };
  ASSERT_TRUE(wait_until(completed, 90)) << log() << shell("scontrol show job " + job).text;
  EXPECT_NE(bits_of("slurm_run"), half_way);
  EXPECT_EQ(bits_of("slurm_run"), bits_of_our_spawn(steps)) << log();
}

}  // namespace
}  // namespace earshot
