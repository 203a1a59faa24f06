// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/isolated_call.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/temporary_folder.h"
#include "tests/support/programs/isolated_calls.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using namespace isolated_calls;
using Clock = std::chrono::steady_clock;

std::size_t open_descriptors() {
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) count += entry.path().empty() ? 0 : 1;
  return count;
}

TEST(IsolatedCall, GivesTheAnswer) {
  EXPECT_EQ(call({"echo", "hello"}), "hello");
  EXPECT_EQ(call({"echo", ""}), "");
  EXPECT_EQ(call({"large", "50000000"}), std::string(50'000'000, 'x'));
  EXPECT_EQ(call({"print"}), "quiet") << "what a library prints is not part of the answer";
}

TEST(IsolatedCall, ARefusalKeepsItsWords) {
  EXPECT_EQ(refusal({"refuse", "house.obj"}), InputError("house.obj", "is of no use", "take another").what());
  EXPECT_EQ(refusal({"refuse", "else.mtl"}), "house.obj: else.mtl: is of no use; take another");
  EXPECT_EQ(refusal({"throw"}), "house.obj: a library gave up");
}

TEST(IsolatedCall, ACrashIsARefusal) {
  for (const char* mode : {"segv", "abort", "overflow"})
    EXPECT_THAT(refusal({mode}), AllOf(StartsWith("house.obj: "), HasSubstr("the library that reads it"), Not(HasSubstr("\n")))) << mode;
  EXPECT_THAT(refusal({"exit"}), HasSubstr("exit with code 3"));
  EXPECT_THAT(refusal({"leave"}), HasSubstr("an incomplete answer"));
}

TEST(IsolatedCall, AnEndlessReadEndsAtTheLimit) {
  constexpr IsolationLimits brief{.wall_time = std::chrono::milliseconds(500), .memory_bytes = std::uint64_t{256} << 20};
  for (const char* mode : {"sleep", "spin", "deaf", "half_then_sleep"}) {
    const auto start = Clock::now();
    EXPECT_THAT(refusal({mode}, brief), AllOf(StartsWith("house.obj: "), HasSubstr("within 0.5 s"))) << mode;
    const double elapsed_s = std::chrono::duration<double>(Clock::now() - start).count();
    EXPECT_GE(elapsed_s, 0.5) << mode;
    EXPECT_LT(elapsed_s, 5.0) << mode << " (the rest is for a busy machine)";
  }
}

TEST(IsolatedCall, MemoryIsBounded) {
  // 8 GB are requested, in blocks that malloc maps one by one and in blocks that it cuts from an arena.
  for (const char* block : {"67108864", "20000"}) {
    const std::string text = refusal({"allocate", block});
    EXPECT_THAT(text, StartsWith("house.obj: ")) << block;
#ifndef EARSHOT_SANITIZED
    EXPECT_THAT(text, HasSubstr("more than 256 MB")) << block;  // a sanitizer's allocator ends the program instead of throwing
#endif
  }
  EXPECT_THAT(refusal({"large", "300000000"}), StartsWith("house.obj: ")) << "the answer counts too";
}

TEST(IsolatedCall, AHalfOrWrongAnswerIsARefusal) {
  for (const char* mode : {"half", "header", "garbage", "flipped", "huge"})
    EXPECT_THAT(refusal({mode}), AllOf(StartsWith("house.obj: "), HasSubstr("an incomplete answer"))) << mode;
}

TEST(IsolatedCall, CannotWriteFiles) {
  const auto file = std::filesystem::temp_directory_path() / ("earshot_isolated_" + std::to_string(::getpid()));
  refusal({"write", file.string()});
  std::error_code error;
  EXPECT_TRUE(!std::filesystem::exists(file) || std::filesystem::file_size(file) == 0);
  std::filesystem::remove(file, error);
}

TEST(IsolatedCall, LeavesNoProcessAndNoDescriptor) {
  const std::size_t before = open_descriptors();
  constexpr IsolationLimits brief{.wall_time = std::chrono::milliseconds(300), .memory_bytes = std::uint64_t{256} << 20};
  for (const char* mode : {"echo", "segv", "sleep", "half", "garbage", "exit", "refuse"}) refusal({mode, "x"}, brief);
  EXPECT_THROW(call_isolated("/no/such/program", {}, "house.obj"), RunError);
  EXPECT_EQ(open_descriptors(), before);
  EXPECT_FALSE(has_children());
}

TEST(IsolatedCall, AnswersThoughSomebodyElseTakesTheStatus) {
  const auto previous = std::signal(SIGCHLD, SIG_IGN);  // the kernel then waits for children itself
  EXPECT_EQ(call({"echo", "hello"}), "hello");
  EXPECT_THAT(refusal({"segv"}), StartsWith("house.obj: "));
  std::signal(SIGCHLD, previous);
}

TEST(IsolatedCall, WorksWithoutStandardStreams) {
  const pid_t daemon = ::fork();
  if (daemon == 0) {
    for (const int descriptor : {0, 1, 2}) ::close(descriptor);
    ::_exit(call({"echo", "hello"}) == "hello" ? 0 : 1);
  }
  int status = -1;
  ASSERT_EQ(::waitpid(daemon, &status, 0), daemon);
  EXPECT_EQ(status, 0);
}

TEST(IsolatedCall, EndsWithTheRun) {
  const pid_t run = ::fork();
  if (run == 0) {
    refusal({"sleep"}, {.wall_time = std::chrono::milliseconds(60'000)});
    ::_exit(0);
  }
  const auto child_of = [](pid_t parent) {
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
      std::ifstream stat(entry.path() / "stat");
      std::string number, name, state;  // no name here has a space
      pid_t its_parent = 0;
      if (stat >> number >> name >> state >> its_parent && its_parent == parent) return static_cast<pid_t>(std::stol(number));
    }
    return pid_t{0};
  };
  pid_t child = 0;
  if (!wait_until([&] { return (child = child_of(run)) != 0; }, 20, {&run, 1})) {
    ::kill(run, SIGKILL);
    ::waitpid(run, nullptr, 0);
    FAIL() << "the call started no process within 20 s";
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  ::kill(run, SIGKILL);
  ASSERT_EQ(::waitpid(run, nullptr, 0), run);
  const auto is_there = [&] {
    std::ifstream status("/proc/" + std::to_string(child) + "/stat");
    std::string number, name, state;
    return static_cast<bool>(status >> number >> name >> state) && state != "Z";
  };
  EXPECT_TRUE(wait_until([&] { return !is_there(); }, 20));
}

// The dynamic loader exits with 127 when a library is missing: the file is not to blame.
TEST(IsolatedCall, SaysWhenALibraryOfTheProgramIsMissing) {
  const TemporaryFolder folder("/tmp", "earshot-test-");
  const std::filesystem::path reader = folder.path() / "reader";
  std::ofstream(reader) << "#!/bin/sh\nexit 127\n";
  std::filesystem::permissions(reader, std::filesystem::perms::owner_all);
  EXPECT_THROW(call_isolated(reader, {}, "house.obj"), RunError);
}

TEST(IsolatedCall, SaysWhenThereIsNoProgram) {
  EXPECT_THROW(call_isolated("/no/such/program", {}, "house.obj"), RunError);
  EXPECT_EQ(std::system((program.string() + " echo x 2>/dev/null").c_str()) >> 8, 2) << "by hand it says that it is not for that";
}

TEST(IsolatedCall, LimitsGrowWithTheFile) {
  const IsolationLimits missing_file_limits = limits_for_file("/no/such/file");
  EXPECT_EQ(missing_file_limits.wall_time, std::chrono::milliseconds(30'000));
  EXPECT_EQ(missing_file_limits.memory_bytes, std::uint64_t{1} << 30);
  const IsolationLimits program_limits = limits_for_file("/proc/self/exe");
  const std::uint64_t size = std::filesystem::file_size("/proc/self/exe");
  EXPECT_EQ(program_limits.memory_bytes, (std::uint64_t{1} << 30) + 40 * size);
}

TEST(AnswerFrame, OnlyAWholeOneIsTaken) {
  const std::string bytes = "some bytes", frame = answer_header(AnswerKind::refusal, bytes) + bytes;
  const Answer answer = decode_answer(frame, 100);
  ASSERT_EQ(answer.state, Answer::State::whole);
  EXPECT_EQ(answer.kind, AnswerKind::refusal);
  EXPECT_EQ(answer.bytes, bytes);
  for (std::size_t size = 0; size < frame.size(); ++size)
    EXPECT_EQ(decode_answer(std::string_view(frame).substr(0, size), 100).state, Answer::State::cut_short) << size;
  for (std::size_t at = 0; at < frame.size(); ++at) {
    std::string flipped = frame;
    flipped[at] ^= 0x40;
    EXPECT_NE(decode_answer(flipped, 100).state, Answer::State::whole) << at;
  }
  EXPECT_EQ(decode_answer(frame + "x", 100).state, Answer::State::damaged);
  EXPECT_EQ(decode_answer(frame, 5).state, Answer::State::damaged) << "more than the bound";
}

}  // namespace
}  // namespace earshot
