// SPDX-License-Identifier: Apache-2.0
// How a run ends: exit codes, and the checkpoint that it leaves whatever ends it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <thread>

#include "tests/support/programs/run_cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;

class RunEndCli : public RunCli {
 protected:
  /// Waits until the run has made so many updates.
  void wait_for_update(int update) const {
    for (int tries = 0; tries < 12000; ++tries) {
      if (std::filesystem::exists(path("run/events.jsonl")) && std::ranges::count(read_file(path("run/events.jsonl")), '\n') >= update)
        return;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    FAIL() << "no update " << update;
  }
  /// The checkpoint of the end can be gone on with, for one more update.
  void expect_resumable(const std::string& workers) const {
    const std::uint64_t update = newest_update();
    expect_done("train " + config_ + " --workers " + workers + " --resume " + path("run") +
                " total_steps=" + std::to_string(8 * std::stoi(workers) * (static_cast<int>(update) + 1)));
    EXPECT_EQ(newest_update(), update + 1);
  }
};

TEST_F(RunEndCli, ASignalEndsItWithACheckpointAndItsCode) {
  const std::vector<std::pair<int, int>> codes{{SIGINT, 130}, {SIGTERM, 143}, {SIGUSR1, 143}};
  for (const char* workers : {"1", "2"})
    for (const auto& [signal, code] : codes) {
      const auto run = start({"total_steps=100000", "checkpoint_every=1000", "--workers", workers});
      ASSERT_TRUE(is_under_way());
      wait_for_update(2);
      run->signal(signal);
      EXPECT_EQ(run->wait(), code) << run->text();
      EXPECT_GE(update_of("run/checkpoints/last.ckpt"), 2u) << "checkpoint_every is far off";
      EXPECT_THAT(run->text(), HasSubstr("checkpoint: " + path("run/checkpoints/last.ckpt")));
    }
  expect_resumable("2");
  EXPECT_THAT(earshot("--help").text, AllOf(HasSubstr("Exit codes: 0 done; 1 failed"), HasSubstr("143")));
}

// Ctrl-C reaches `tee` as well, and the run's next line goes nowhere.
TEST_F(RunEndCli, AClosedPipeIsNoReasonToEnd) {
  for (const std::string workers : {"1", "2"}) {
    const std::string train = earshot_program().string() + " train " + config_ + " --workers " + workers;
    std::filesystem::remove_all(path("run"));
    BackgroundProgram piped("{ " + train + " total_steps=100000 2>&1; echo $? >" + path("code") + "; } | head -1", path("first"));
    ASSERT_TRUE(is_under_way());
    wait_for_update(4);
    EXPECT_TRUE(piped.is_running());
    std::filesystem::remove(path("code"));
    // All of the group but the shell, as a terminal does it; `head` has gone long ago.
    piped.signal_all(SIGINT);
    ASSERT_TRUE(BackgroundProgram::wait_for(path("run/checkpoints/last.ckpt")));
    piped.wait();
    EXPECT_GE(update_of("run/checkpoints/last.ckpt"), 3u);
    expect_resumable(workers);
  }
}

// With network.on_loss=stop, the default.
TEST_F(RunEndCli, WhoeverSurvivesTheLossOfAWorkerSavesTheLastUpdate) {
  for (const int victim : {0, 1, 2}) {
    const auto run = start({"total_steps=100000", "checkpoint_every=1000", "--workers", "3"});
    ASSERT_TRUE(is_under_way());
    wait_for_update(4);
    // The workers are started in the order of their ranks.
    const std::string children = "/proc/" + std::to_string(run->pid()) + "/task/" + std::to_string(run->pid()) + "/children";
    std::istringstream numbers(read_file(children));
    std::vector<pid_t> workers;
    for (pid_t child = 0; numbers >> child;) workers.push_back(child);
    ASSERT_EQ(workers.size(), 3u);
    ::kill(workers[static_cast<std::size_t>(victim)], SIGKILL);
    const auto updates = std::ranges::count(read_file(path("run/events.jsonl")), '\n');
    EXPECT_EQ(run->wait(), 3) << run->text();
    EXPECT_GE(newest_update() + 1, static_cast<std::uint64_t>(updates)) << run->text();
    EXPECT_GE(newest_update(), 3u);
    expect_resumable("3");
  }
}

// A real one, of a size that holds so many checkpoints.
TEST_F(RunEndCli, AFullDiskCostsOlderCheckpointsAndNoUpdate) {
  if (std::system("unshare -Urm mount -t tmpfs tmpfs /mnt 2>/dev/null") != 0) GTEST_SKIP() << "no file system can be mounted here";
  // Checkpoints of some MB, beside which curves and their picture are small.
  const std::string large = " policy.hidden_size=256";
  expect_done("train " + config_ + large + " total_steps=8");
  const auto checkpoint = static_cast<double>(std::filesystem::file_size(path("run/checkpoints/last.ckpt")));
  const std::string program = earshot_program().string(), disk = path("disk"), log = path("log");
  std::filesystem::create_directory(disk);
  // filler: goes once the run waits.
  const auto on_disk = [&](double checkpoints, double filler) {
    const auto bytes = [&](double count, double more) { return std::to_string(static_cast<std::uint64_t>(count * checkpoint + more)); };
    const std::string script = "mount -t tmpfs -o size=" + bytes(checkpoints + filler, 200e3) + " tmpfs " + disk + " && head -c " +
                               bytes(filler, 0) + " /dev/zero >" + disk + "/filler; ( until grep -q \"waits for room\" " + log +
                               "; do sleep 0.1; done; rm " + disk + "/filler ) & " + program + " train " + config_ + " total_steps=80" +
                               large + " out=" + disk + "/run >" + log + " 2>&1; code=$?; kill $! 2>/dev/null; " + program + " policy " +
                               disk + "/run; exit $code";
    BackgroundProgram run("unshare -Urm sh -c '" + script + "'", path("first"));
    EXPECT_EQ(run.wait(), 0) << read_file(log);
    EXPECT_THAT(run.text(), HasSubstr("80 steps")) << read_file(log);
    return read_file(log);
  };
  // Beside the best, the newest and the one that is being written.
  EXPECT_THAT(on_disk(3.6, 0), HasSubstr("is removed to make room"));
  EXPECT_THAT(on_disk(1.5, 1), HasSubstr("waits for room"));
}

TEST_F(RunEndCli, WeightsThatGoBadEndItAtTheLastGoodOnes) {
  for (const char* workers : {"1", "2"}) {
    const auto run = start({"total_steps=100000", "ppo.learning_rate=1e9", "--workers", workers});
    EXPECT_EQ(run->wait(), 1) << run->text();
    EXPECT_THAT(run->text(), AllOf(HasSubstr("the weights have gone bad"), HasSubstr("ppo.learning_rate = 1e+09 (default 0.00025)"),
                                   HasSubstr("last.ckpt holds update 0, the last good one")));
    expect_done("train " + config_ + " --workers " + workers + " --resume " + path("run") +
                " --change ppo.learning_rate ppo.learning_rate=1e-3 total_steps=16");
  }
}

TEST_F(RunEndCli, BadWeightsAreRolledBackWhereTheConfigSaysSo) {
  const auto run = start({"total_steps=100000", "ppo.learning_rate=1e9", "ppo.roll_backs=2", "--workers", "2"});
  EXPECT_EQ(run->wait(), 1) << run->text();
  EXPECT_THAT(run->text(),
              AllOf(HasSubstr("update 1: the weights have gone bad"), HasSubstr("the run goes on from those of update 0"),
                    HasSubstr("update 2: the weights have gone bad"), HasSubstr("the run goes on from those of update 1"),
                    HasSubstr("update 3: the weights have gone bad"), HasSubstr("last.ckpt holds update 2, the last good one")));
}

TEST_F(RunEndCli, WhatIsBeyondTheMachineIsRefused) {
  const std::string train = "train " + config_;
  expect_refused(train + " rollout_steps=2000000000", AllOf(HasSubstr("rollout_steps = 2000000000"), HasSubstr("--force")));
  expect_refused(train + " envs_per_worker=100000000", AllOf(HasSubstr("envs_per_worker = 100000000"), HasSubstr("--force")));
  const unsigned too_many = 16 * std::thread::hardware_concurrency() + 1;
  if (too_many <= 1024)
    expect_refused(train + " --workers " + std::to_string(too_many),
                   AllOf(HasSubstr(std::to_string(too_many) + " workers"), HasSubstr("--force")));
  EXPECT_FALSE(std::filesystem::exists(path("run")));
}

// A limit on the address space stands for a machine without memory: one line, at once, and no core.
TEST_F(RunEndCli, WithoutMemoryItEndsWithOneLine) {
  for (const std::string workers : {"1", "2"})
    for (const std::string size : {"rollout_steps=100000000", "envs_per_worker=2000000"}) {
      BackgroundProgram run("ulimit -c 0; ulimit -v 2500000; exec " + earshot_program().string() + " train " + config_ + " --force " +
                                size + " --workers " + workers,
                            path("first"));
      EXPECT_EQ(run.wait(100), 1) << run.text();
      EXPECT_THAT(run.text(), HasSubstr("earshot: out of memory")) << size;
      EXPECT_THAT(run.text(), testing::Not(AnyOf(HasSubstr("terminate called"), HasSubstr("signal")))) << size;
    }
  // A limit that the libraries alone nearly fill is found before the start.
  BackgroundProgram run("ulimit -c 0; ulimit -v 1000000; exec " + earshot_program().string() + " train " + config_, path("first"));
  EXPECT_EQ(run.wait(100), 2) << run.text();
  EXPECT_THAT(run.text(), HasSubstr("the limit (ulimit -v) is"));
}

}  // namespace
}  // namespace earshot
