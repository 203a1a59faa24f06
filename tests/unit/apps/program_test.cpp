// SPDX-License-Identifier: Apache-2.0
// Commands of the two programs: help, unknown commands, and the switch from one program to the other.

#include "apps/program.h"

#include <fstream>

#include "sim/base/install_paths.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST_F(Cli, HelpIsComplete) {
  const CliOutcome help = earshot("--help");
  EXPECT_EQ(help.exit_code, 0);
  for (const char* command : {"doctor", "scene", "materials", "rir", "walk", "dataset", "train", "eval", "leaderboard", "bench"}) {
    EXPECT_THAT(help.output, HasSubstr(command));
    EXPECT_EQ(earshot(std::string(command) + " --help").exit_code, 0) << command;
  }
}

TEST_F(Cli, WordsThatAreNoCommandAreRefusedWithTheNearest) {
  expect_bad_input("dance", "one of: bench, benchmark, completion");
  expect_bad_input("", "one of: bench, benchmark, completion");
  expect_bad_input("rirr shoebox:5x3x4", "did you mean 'rir'?");
  expect_bad_input("evla random", "did you mean 'eval'?");
  expect_bad_input("dataset", "one of: convolve, episodes, grid, pano, rir, scenes");
  expect_bad_input("dataset episode house:1", "did you mean 'dataset episodes'?");
  expect_bad_input("bench", "one of: accuracy, allreduce");
  expect_bad_input("bench rirs", "did you mean 'bench rir'?");
  expect_bad_input("rir shoebox:5x3x4", "--source");
}

// What is asked of the program with libtorch is what that program is given, word for word, and its exit code is the answer.
TEST_F(Cli, CommandsOfTheProgramBesideAreItsOwn) {
  const std::filesystem::path alone = folder_ / "alone", beside = alone / "earshot_training";
  std::filesystem::create_directory(alone);
  std::filesystem::copy_file(earshot_program(), alone / "earshot");
  EXPECT_EQ(run((alone / "earshot").string() + " rir --help").exit_code, 0);
  std::ofstream(beside) << "#!/bin/sh\nprintf '[%s]' \"$@\"\nexit 7\n";
  std::filesystem::permissions(beside, std::filesystem::perms::owner_all);
  const CliOutcome passed_on = run((alone / "earshot").string() + " train 'two words.yaml' key=1");
  EXPECT_EQ(passed_on.exit_code, 7);
  EXPECT_EQ(passed_on.output, "[train][two words.yaml][key=1]");
}

TEST_F(Cli, LackOfTheProgramBesideIsSaid) {
  const std::filesystem::path alone = folder_ / "alone", installed = std::filesystem::path(kInstalledPrograms) / "earshot_training";
  if (std::filesystem::exists(installed)) GTEST_SKIP() << installed << " would be started";
  std::filesystem::create_directory(alone);
  std::filesystem::copy_file(earshot_program(), alone / "earshot");
  const CliOutcome lost = run((alone / "earshot").string() + " train quick.yaml");
  EXPECT_EQ(lost.exit_code, 1);
  EXPECT_THAT(lost.errors, AllOf(HasSubstr("earshot_training: is neither in " + alone.string()), HasSubstr("build or install it")));
}

}  // namespace
}  // namespace earshot
