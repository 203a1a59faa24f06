// SPDX-License-Identifier: Apache-2.0
// Files that say they are results: how large, how costly to refuse.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include "evaluation/results/result.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/stopwatch.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Largest resident memory of this process so far.
long peak_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::stol(line.substr(6)) / 1024;
  return -1;
}

struct Cost {
  bool loaded = false;
  double seconds = 0;
  long mb = 0;
};

/// Of reading a file, in a process of its own.
Cost cost_of(const std::string& path) {
  int ends[2];
  EXPECT_EQ(::pipe(ends), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    Cost cost;
    std::ofstream("/proc/self/clear_refs") << "5";  // VmHWM from here on
    const long before = peak_mb();
    const Stopwatch watch;
    try {
      static_cast<void>(load_result(path));
      cost.loaded = true;
    } catch (const InputError&) {
    }
    cost.seconds = watch.wall_s();
    cost.mb = peak_mb() - before;
    const bool told = ::write(ends[1], &cost, sizeof(cost)) == sizeof(cost);
    ::_exit(told ? 0 : 1);
  }
  ::close(ends[1]);
  Cost cost;
  EXPECT_EQ(::read(ends[0], &cost, sizeof(cost)), static_cast<ssize_t>(sizeof(cost))) << path;
  ::close(ends[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  return cost;
}

EvaluationResult long_result(int episodes, int steps) {
  EvaluationResult result;
  result.agent = "long";
  for (int i = 0; i < episodes; ++i) {
    EvaluationResult::Row row{.id = std::to_string(i), .scene = "house:" + std::to_string(40000 + i / 10), .metrics = {}, .actions = {}};
    row.sound = "synth:telephone:100";
    row.actions.assign(static_cast<std::size_t>(steps), 1);
    result.episodes.push_back(std::move(row));
  }
  return result;
}

// The longest of `standard`: 500 episodes of 500 steps; four times that is read.
TEST(ResultSize, FourTimesTheLongestOfStandardIsRead) {
  const TempFolder folder;
  save_result(long_result(500, 500), folder / "one.json");
  EXPECT_LT(4 * std::filesystem::file_size(folder / "one.json"), kMaxResultBytes);
  save_result(long_result(2000, 500), folder / "four.json");
  const Cost cost = cost_of(folder / "four.json");
  EXPECT_TRUE(cost.loaded);
  EXPECT_LT(cost.mb, 300);
}

TEST(ResultSize, WhatIsLargerOrFullOfSmallThingsIsRefusedWithin300MB) {
  const TempFolder folder;
  const auto filled = [&](const std::string& with, std::size_t bytes) {
    std::string text = "{\"episodes\": [";
    while (text.size() + with.size() + 2 < bytes) text += with;
    return folder.write("filled.json", text + "1]}");
  };
  for (const char* with : {"1,", "[],", "{},", "\"\",", "{\"a\":1},", "[[1]],", "\"abcdefghijklmnopqrstuvwxyz\",", "1.5e10,", "null,"}) {
    const Cost cost = cost_of(filled(with, kMaxResultBytes));
    EXPECT_FALSE(cost.loaded) << with;
    EXPECT_LT(cost.mb, 300) << with;
  }
  // Just below every bound at once.
  std::string full = "{\"episodes\": [";
  for (int i = 0; i < 3'200'000; ++i) full += "1,";
  for (int i = 0; i < 690'000; ++i) full += "\"abcdefghijklmnop\",";
  for (int i = 0; i < 99'000; ++i) full += "{},";
  EXPECT_LT(cost_of(folder.write("full.json", full + "1]}")).mb, 300);
  const Cost above = cost_of(filled("1,", kMaxResultBytes + 10));
  EXPECT_FALSE(above.loaded);
  EXPECT_LT(above.mb, 10);
  EXPECT_LT(above.seconds, 1);
}

TEST(ResultSize, WhatNeverEndsIsRefusedAtOnce) {
  const TempFolder folder;
  ASSERT_EQ(::mkfifo(std::string(folder / "pipe").c_str(), 0600), 0);
  for (const std::string& path : {std::string(folder / "pipe"), std::string("/dev/zero"), std::string("/dev/stdin")}) {
    const Cost cost = cost_of(path);
    EXPECT_FALSE(cost.loaded) << path;
    EXPECT_LT(cost.seconds, 1) << path;
  }
}

}  // namespace
}  // namespace earshot
