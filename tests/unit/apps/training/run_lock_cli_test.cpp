// SPDX-License-Identifier: Apache-2.0
// The folder of a run belongs to one process at a time, however the second one comes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <thread>

#include "sim/base/random.h"
#include "tests/support/programs/run_cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// A first run with what the second processes try meanwhile: train, resume, overwrite, eval in turn, on 1 or 2 workers.
class RunLockCli : public RunCli {
 protected:
  static constexpr const char* kSteps = " total_steps=480";

  [[nodiscard]] std::string attempt(std::uint32_t number) const {
    const std::string train = "train " + config_ + kSteps;
    switch (number % 5) {
      case 0:
        return train;
      case 1:
        return train + " --resume " + path("run");
      case 2:
        return train + " --overwrite";
      case 3:
        return train + " --overwrite --workers 2";
      default:
        return "eval random --config " + config_ + " --out " + path("run/result.json");
    }
  }
  /// Tries until `tries` were refused; each run under way is let to its end and has the bits of one that was alone.
  void expect_all_refused(int tries) {
    expect_done("train " + config_ + kSteps + " out=" + path("alone"));
    const std::uint64_t expected = bits_of("alone/checkpoints/last.ckpt");
    int refused = 0, runs = 0;
    for (std::uint32_t number = 0; refused < tries; ++runs) {
      const auto first = start({"total_steps=480", "--overwrite"});
      const std::string holder = "in use by process " + std::to_string(first->pid()) + " (earshot train) on host ";
      ASSERT_TRUE(BackgroundProgram::wait_for(path("run/run.lock")));
      // At any moment of it.
      std::this_thread::sleep_for(std::chrono::duration<double>(RandomStream(35, Purpose::test, number).uniform(0) * 0.5));
      bool is_replaced = false;
      while (refused < tries) {
        const Outcome second = earshot(attempt(number));
        // What came after the end of the first run was a run of its own.
        is_replaced = !first->is_running() && second.text.find(holder) == std::string::npos;
        if (is_replaced) break;
        EXPECT_EQ(second.exit_code, 2) << attempt(number) << "\n" << second.text;
        EXPECT_THAT(second.text, AllOf(HasSubstr(holder), HasSubstr(", since 20"))) << attempt(number);
        EXPECT_EQ(std::ranges::count(second.text, '\n'), 1) << second.text;
        ++refused;
        ++number;
        if (!first->is_running()) break;
      }
      ASSERT_EQ(first->wait(), 0) << first->text();
      if (!is_replaced) {
        EXPECT_EQ(bits_of("run/checkpoints/last.ckpt"), expected);
      }
    }
    std::printf("%d refused, beside %d runs\n", refused, runs);
    const auto last = start({"total_steps=480", "--overwrite"});
    ASSERT_EQ(last->wait(), 0) << last->text();
    EXPECT_EQ(bits_of("run/checkpoints/last.ckpt"), expected);
    EXPECT_FALSE(std::filesystem::exists(path("run/run.lock")));
    EXPECT_FALSE(std::filesystem::exists(path("run/result.json")));
  }
};

// One of each kind.
TEST_F(RunLockCli, FiveSecondProcessesAreRefused) { expect_all_refused(5); }

TEST_F(RunLockCli, AHundredSecondProcessesAreRefused) { expect_all_refused(100); }

TEST_F(RunLockCli, ALeaseDoesTheSame) {
  ASSERT_EQ(::setenv("EARSHOT_RUN_LOCK_KIND", "lease", 1), 0);
  for (const char* workers : {"1", "2"}) {
    const auto first = start({"total_steps=4000", "--workers", workers});
    ASSERT_TRUE(is_under_way());
    expect_refused(attempt(1), HasSubstr("in use by process " + std::to_string(first->pid()) + " (earshot train)"));
    // Killed, it is gone for whoever is on the same machine: no lease is waited for.
    first->signal_all(SIGKILL);
    EXPECT_EQ(first->wait(), 128 + SIGKILL);
    const std::uint64_t reached = newest_update();
    expect_done("train " + config_ + " --workers " + workers + " --resume " + path("run") +
                " total_steps=" + std::to_string(8 * (reached + 1)));
  }
  ASSERT_EQ(::setenv("EARSHOT_RUN_LOCK_KIND", "magnet", 1), 0);
  expect_refused(attempt(2), HasSubstr("EARSHOT_RUN_LOCK_KIND = magnet"));
  ASSERT_EQ(::unsetenv("EARSHOT_RUN_LOCK_KIND"), 0);
}

TEST_F(RunLockCli, AllKilledAndResumedAtOnce) {
  for (const char* workers : {"1", "3"}) {
    const auto first = start({"total_steps=100000", "--workers", workers});
    ASSERT_TRUE(is_under_way());
    first->signal(SIGKILL);  // the parent alone: its workers end with it
    const Outcome next = earshot("train " + config_ + " --workers " + workers + " --resume " + path("run") + " total_steps=8");
    EXPECT_EQ(next.exit_code, 0) << next.text;
    first->wait();
  }
}

// Slurm starts a job again while its former processes still end.
TEST_F(RunLockCli, ARestartOfTheJobWaitsAndGoesOn) {
  ASSERT_EQ(::setenv("SLURM_JOB_ID", "4711", 1), 0);
  const auto first = start({"total_steps=100000"});
  const pid_t holder = first->pid();
  ASSERT_TRUE(is_under_way());
  const auto second = start({"--resume", path("run"), "total_steps=100000"}, "second");
  ASSERT_TRUE(second->has_written("waits for process " + std::to_string(holder) + " (earshot train)")) << second->text();
  first->signal(SIGTERM);
  EXPECT_EQ(first->wait(), 143) << first->text();
  const std::uint64_t reached = update_of("run/checkpoints/last.ckpt");
  ASSERT_TRUE(second->has_written("update ")) << second->text();
  second->signal(SIGTERM);
  EXPECT_EQ(second->wait(), 143) << second->text();
  EXPECT_GT(update_of("run/checkpoints/last.ckpt"), reached);
  ASSERT_EQ(::unsetenv("SLURM_JOB_ID"), 0);
}

}  // namespace
}  // namespace earshot
