// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_lock.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <sstream>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/error_message.h"
#include "tests/support/seconds_since.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/run_claim.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;
using testing::AllOf;
using testing::HasSubstr;
using Kind = RunLockOptions::Kind;

/// Both kinds of lock keep the same promises; a lease is short here.
class RunLockOf : public testing::TestWithParam<Kind> {
 protected:
  [[nodiscard]] RunLockOptions options(const std::string& job = {}) const {
    return {.kind = GetParam(), .lease = milliseconds(900), .grace = milliseconds(6000), .job = job};
  }
  [[nodiscard]] std::filesystem::path run() const { return folder_.path() / "run"; }
  [[nodiscard]] std::filesystem::path file() const { return run() / "run.lock"; }
  [[nodiscard]] std::string refusal(const RunLockOptions& options) const {
    try {
      const auto lock = RunLock::acquire(run(), "test", options);
    } catch (const InputError& error) {
      return error.what();
    }
    return "taken";
  }
  /// A process that takes the lock, says so, and does what is asked.
  pid_t start_holder(const RunLockOptions& options, const std::function<void(RunLock&)>& then) {
    held_[0] = 0;
    const pid_t pid = WorkerProcesses::start(0, [&](int) {
      const auto lock = RunLock::acquire(run(), "earshot train", options);
      held_[0] = 1;
      then(*lock);
      return true;
    });
    EXPECT_TRUE(wait_until([&] { return held_[0] != 0; }));
    return pid;
  }
  static void end(pid_t pid, int signal = SIGKILL) {
    ::kill(pid, signal);
    ::waitpid(pid, nullptr, 0);
  }

  PrivateTestFolder folder_;
  SharedArray<std::atomic<int>, 4> held_;
};
INSTANTIATE_TEST_SUITE_P(Kinds, RunLockOf, testing::Values(Kind::kernel, Kind::lease),
                         [](const auto& kind) { return kind.param == Kind::kernel ? "Kernel" : "Lease"; });

TEST_P(RunLockOf, ASecondProcessIsToldAtOnceWhoHoldsIt) {
  const pid_t holder = start_holder(options("slurm 1"), [](RunLock&) { ::pause(); });
  const auto start = std::chrono::steady_clock::now();
  for (const char* job : {"", "slurm 2"})
    EXPECT_THAT(refusal(options(job)),
                AllOf(HasSubstr(run().string() + ": is in use by process " + std::to_string(holder) + " (earshot train) on host "),
                      HasSubstr(", since 20")));
  EXPECT_LT(seconds_since(start), 0.5);
  end(holder);
  EXPECT_EQ(refusal(options()), "taken");
  EXPECT_FALSE(std::filesystem::exists(run()) && std::filesystem::exists(file())) << "removed at an orderly end";
}

TEST_P(RunLockOf, ARestartOfTheSameJobWaits) {
  const pid_t holder = start_holder(options("slurm 7"), [](RunLock&) { std::this_thread::sleep_for(milliseconds(700)); });
  EXPECT_THAT(refusal(options("slurm 8")), HasSubstr("is in use"));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(refusal(options("slurm 7")), "taken");
  EXPECT_GT(seconds_since(start), 0.2);
  ::waitpid(holder, nullptr, 0);
  // Not for ever.
  const pid_t stays = start_holder(options("slurm 7"), [](RunLock&) { ::pause(); });
  RunLockOptions impatient = options("slurm 7");
  impatient.lease = milliseconds(300);
  impatient.grace = milliseconds(200);
  if (GetParam() == Kind::kernel) {
    EXPECT_THAT(refusal(impatient), HasSubstr("is in use"));
  }
  end(stays);
}

// The processes of a run are killed and it is started again at once, while the kernel still ends them.
TEST_P(RunLockOf, AllKilledAndResumedAtOnce) {
  for (int round = 0; round < 20; ++round) {
    const pid_t holder = start_holder(options(), [&](RunLock&) {
      // Workers that hold it too, as they have its descriptor.
      for (int i = 0; i < 2; ++i)
        if (::fork() == 0) {
          ::alarm(20);
          ++held_[1];
          while (true) ::pause();
        }
      ::pause();
    });
    ASSERT_TRUE(wait_until([&] { return held_[1] >= 2; }));
    held_[1] = 0;
    const std::string children = read_file("/proc/" + std::to_string(holder) + "/task/" + std::to_string(holder) + "/children");
    ::kill(holder, SIGKILL);
    std::istringstream numbers(children);
    for (pid_t child = 0; numbers >> child;) ::kill(child, SIGKILL);
    EXPECT_EQ(refusal(options()), "taken") << round;
    ::waitpid(holder, nullptr, 0);
  }
}

// Of many that come at the same moment to a folder whose holder was killed, one has it at a time.
TEST_P(RunLockOf, OneOfManyThatComeAtOnce) {
  constexpr int kMany = 6, kRounds = 12;
  for (int round = 0; round < kRounds; ++round) {
    end(start_holder(options(), [](RunLock&) { ::pause(); }));
    ASSERT_TRUE(std::filesystem::exists(file()));
    held_[1] = held_[2] = held_[3] = 0;
    WorkerProcesses many(kMany, [&](int) {
      ++held_[3];
      if (!wait_until([&] { return held_[3] >= kMany; })) return false;
      try {
        const auto lock = RunLock::acquire(run(), "earshot train", options());
        if (++held_[1] != 1) return false;  // two at a time
        std::this_thread::sleep_for(milliseconds(300));
        --held_[1];
        ++held_[2];
      } catch (const InputError&) {
      }
      return true;
    });
    many.expect_all_succeed();
    EXPECT_GE(held_[2], 1) << round;
  }
}

TEST_P(RunLockOf, WhatItMadeGoesIfNothingCameOfIt) {
  const std::filesystem::path deep = folder_.path() / "a" / "b" / "run";
  { const auto lock = RunLock::acquire(deep, "test", options()); }
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "a"));
  {
    const auto lock = RunLock::acquire(deep, "test", options());
    write_file_atomically(deep / "events.jsonl", "x");
  }
  EXPECT_TRUE(std::filesystem::exists(deep / "events.jsonl"));
  EXPECT_FALSE(std::filesystem::exists(deep / "run.lock"));
  write_file_atomically(folder_.path() / "file", "x");
  EXPECT_THAT(error_message([&] { RunLock::acquire(folder_.path() / "file", "test", options()); }), HasSubstr("file"));
}

// The lock belongs to the run: another worker of it takes the place of a holder that stands still.
TEST_P(RunLockOf, TheNextWriterOfTheRunTakesItsPlace) {
  const auto first = RunLock::acquire(run(), "earshot train", options());
  RunLockOptions next = options();
  next.run = first->run();
  const auto second = RunLock::try_acquire(run(), "earshot train", next);
  EXPECT_EQ(second != nullptr, GetParam() == Kind::lease);  // the kernel's stays with the process until it ends
  if (second) {
    EXPECT_EQ(second->run(), first->run());
  }
}

TEST(RunLock, AHolderOnAnotherHostIsGoneOnceItsLeaseIsOld) {
  const PrivateTestFolder folder;
  const std::filesystem::path file = folder.path() / "run.lock";
  const RunLockOptions options{.kind = Kind::lease, .lease = milliseconds(1500), .grace = milliseconds(500)};
  LockRecord record = own_lock_record("earshot train", "");
  record.is_lease = true;
  record.host = "far";
  record.machine = "another/4026531836";
  record.process = 12;
  write_file_atomically(file, encode_lock_record(record));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_THAT(error_message([&] { RunLock::acquire(folder.path(), "test", options); }),
              HasSubstr("process 12 (earshot train) on host far"));
  EXPECT_LT(seconds_since(start), 0.5) << "nothing is waited for";
  while (seconds_since(start) < 1.6) std::this_thread::sleep_for(milliseconds(50));
  EXPECT_NE(RunLock::acquire(folder.path(), "test", options), nullptr);
  // By the kernel on a host of which nothing is known: only the user knows.
  record.is_lease = false;
  write_file_atomically(file, encode_lock_record(record));
  const timespec old[2]{{1000, 0}, {1000, 0}};
  ASSERT_EQ(::utimensat(AT_FDCWD, file.c_str(), old, 0), 0);
  EXPECT_THAT(error_message([&] { RunLock::acquire(folder.path(), "test", options); }), HasSubstr("remove " + file.string()));
}

TEST(RunLock, ALeaseIsRenewedWhileItsHolderLivesAndLostIfItStandsStill) {
  const PrivateTestFolder folder;
  const RunLockOptions options{.kind = Kind::lease, .lease = milliseconds(900), .grace = milliseconds(100)};
  SharedArray<std::atomic<int>, 2> state;
  const pid_t holder = WorkerProcesses::start(0, [&](int) {
    const auto lock = RunLock::acquire(folder.path(), "earshot train", options);
    state[0] = 1;
    const bool is_lost = wait_until([&] { return lock->is_lost(); });
    state[1] = is_lost ? 1 : 0;
    return is_lost;
  });
  ASSERT_TRUE(wait_until([&] { return state[0] != 0; }));
  const auto start = std::chrono::steady_clock::now();
  while (seconds_since(start) < 2.5) {
    EXPECT_EQ(RunLock::try_acquire(folder.path(), "test", options), nullptr);
    std::this_thread::sleep_for(milliseconds(100));
  }
  ::kill(holder, SIGSTOP);
  std::this_thread::sleep_for(milliseconds(1200));
  const auto other = RunLock::acquire(folder.path(), "test", options);
  EXPECT_EQ(state[1], 0);
  ::kill(holder, SIGCONT);
  int status = -1;
  ::waitpid(holder, &status, 0);
  EXPECT_EQ(status, 0) << "it has seen that its lease was lost";
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "run.lock")) << "which is the other's";
  EXPECT_FALSE(other->is_lost());
}

TEST(RunLock, AFileInARunBelongsToIt) {
  const PrivateTestFolder folder;
  const std::filesystem::path run = std::filesystem::canonical(folder.path()) / "run";
  EXPECT_FALSE(run_folder_around(run / "result.json"));
  write_file_atomically(run / "notes.txt", "mine");
  EXPECT_FALSE(run_folder_around(run / "result.json"));
  write_file_atomically(run / "checkpoints" / "last.ckpt", "x");
  EXPECT_EQ(run_folder_around(run / "result.json"), run);
  EXPECT_EQ(run_folder_around(run / "checkpoints" / "result.json"), run);
  EXPECT_FALSE(run_folder_around(run / "results" / "result.json"));
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(run);
  EXPECT_EQ(run_folder_around("result.json"), run);
  std::filesystem::current_path(before);
}

TEST(RunLock, RecordsComeBackAndDamagedOnesAreNone) {
  const LockRecord record = own_lock_record("earshot train", "SLURM_JOB_ID 4");
  EXPECT_FALSE(is_known_gone(record));
  const std::string text = encode_lock_record(record);
  const auto again = decode_lock_record(text);
  ASSERT_TRUE(again);
  EXPECT_EQ(encode_lock_record(*again), text);
  for (std::size_t cut = 0; cut < text.size(); ++cut) EXPECT_FALSE(decode_lock_record(text.substr(0, cut))) << cut;
  LockRecord other = record;
  other.began_ticks += 1;  // the number was given to another process
  EXPECT_TRUE(is_known_gone(other));
  other.machine = "elsewhere";
  EXPECT_FALSE(is_known_gone(other));
}

TEST(RunClaim, AnotherRunInTheFolderEndsTheWriter) {
  const PrivateTestFolder folder;
  RunClaim unlocked;
  unlocked.take();
  unlocked.keep();
  auto lock = RunLock::acquire(folder.path(), "earshot train", {});
  const std::string run = lock->run();
  RunClaim first(folder.path(), std::move(lock), run, false);
  first.take();
  EXPECT_TRUE(first.is_held());
  RunClaim second(folder.path(), nullptr, run, false);
  second.take();  // the writer before it has not ended yet
  EXPECT_FALSE(second.is_held());
  first.give_up();
  second.keep();
  EXPECT_TRUE(second.is_held());
  second.give_up();
  const auto other = RunLock::acquire(folder.path(), "earshot train", {});
  EXPECT_THAT(error_message([&] { second.take(); }), HasSubstr("was taken over by process"));
}

}  // namespace
}  // namespace earshot
