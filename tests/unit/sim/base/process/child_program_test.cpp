// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/child_program.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// A shell whose descriptor 3 is read here.
struct Shell {
  explicit Shell(const std::string& script, std::vector<std::string> passed = {}) {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw RunError("pipe", "cannot be made");
    read_end = Descriptor(ends[0]);
    Descriptor write_end(ends[1]);
    child.emplace(ChildSetup{.program = "/bin/sh",
                             .arguments = {"-c", script},
                             .descriptor = write_end.get(),
                             .variables = {"GIVEN=7"},
                             .passed = std::move(passed)});
  }
  /// Until the other end is closed, or so many bytes.
  [[nodiscard]] std::string text(std::size_t bytes = 1 << 16) const {
    std::string all;
    std::array<char, 4096> part{};
    for (ssize_t count = 0; all.size() < bytes && (count = ::read(read_end.get(), part.data(), part.size())) > 0;)
      all.append(part.data(), static_cast<std::size_t>(count));
    return all;
  }
  Descriptor read_end;
  std::optional<ChildProgram> child;
};

bool has_gone(pid_t process) {
  std::ifstream stat("/proc/" + std::to_string(process) + "/stat");
  std::string line;
  return !std::getline(stat, line) || line.find(") Z ") != std::string::npos;
}

TEST(ChildProgram, GetsOneDescriptorAndTheVariablesThatArePassed) {
  const int inherited = ::dup2(0, 57);  // not closed by exec
  ASSERT_EQ(inherited, 57);
  ASSERT_EQ(::setenv("EARSHOT_SECRET_OF_A_JOB", "s3cret", 1), 0);
  const std::string script = "for i in 3 4 5 57; do [ -e /proc/self/fd/$i ] && echo descriptor $i >&3; done; env >&3";
  EXPECT_THAT(Shell(script, {"PATH"}).text(), AllOf(HasSubstr("descriptor 3\n"), Not(HasSubstr("descriptor 5")), HasSubstr("GIVEN=7\n"),
                                                    HasSubstr("PATH="), Not(HasSubstr("s3cret"))));
  EXPECT_THAT(Shell(script).text(), AllOf(HasSubstr("s3cret"), HasSubstr("GIVEN=7\n"), Not(HasSubstr("descriptor 57"))));
  ::close(inherited);
  ::unsetenv("EARSHOT_SECRET_OF_A_JOB");
}

TEST(ChildProgram, WhatItHasStartedEndsWithIt) {
  Shell shell("sleep 1000 & echo $! >&3; wait");
  const auto started = static_cast<pid_t>(std::stol(shell.text(2)));
  ASSERT_FALSE(has_gone(started));
  const auto status = shell.child->end();
  ASSERT_TRUE(status);
  EXPECT_TRUE(WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL);
  EXPECT_TRUE(wait_until([&] { return has_gone(started); }));
}

TEST(ChildProgram, APatientEndTellsHowItEndedByItself) {
  Shell slow("sleep 0.2; exit 5");
  const auto status = slow.child->end(std::chrono::minutes(1));
  ASSERT_TRUE(status);
  EXPECT_TRUE(WIFEXITED(*status) && WEXITSTATUS(*status) == 5) << *status;
  Shell endless("sleep 1000");
  const auto begin = std::chrono::steady_clock::now();
  const auto killed = endless.child->end(std::chrono::milliseconds(50));
  ASSERT_TRUE(killed);
  EXPECT_TRUE(WIFSIGNALED(*killed));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(60));
}

TEST(ChildProgram, ArgumentsThatAreNoNumbersAreRefused) {
  EXPECT_EQ(number_argument("0"), 0u);
  EXPECT_EQ(number_argument("18446744073709551615"), 18446744073709551615u);
  for (const char* text : {"", "x", "1x", "-1", " 1", "18446744073709551616"}) EXPECT_THROW(number_argument(text), InputError) << text;
}

}  // namespace
}  // namespace earshot
