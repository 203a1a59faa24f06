// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/companion_program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include "sim/base/errors.h"

namespace earshot {
namespace {

TEST(CompanionProgram, IsFoundBesideAndOneFolderUp) {
  const std::filesystem::path program_folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  EXPECT_EQ(companion_program("isolated_child"), program_folder / "isolated_child");
  EXPECT_EQ(companion_program("earshot_reader"), program_folder.parent_path() / "earshot_reader");
}

TEST(CompanionProgram, VariableNamesAnother) {
  ::setenv("EARSHOT_TEST_COMPANION", "/another/program", 1);
  EXPECT_EQ(companion_program("isolated_child", "EARSHOT_TEST_COMPANION"), "/another/program");
  ::setenv("EARSHOT_TEST_COMPANION", "", 1);  // as if not set
  EXPECT_EQ(companion_program("isolated_child", "EARSHOT_TEST_COMPANION").filename(), "isolated_child");
  ::unsetenv("EARSHOT_TEST_COMPANION");
}

TEST(CompanionProgram, LackNamesTheFoldersAndTheVariable) {
  const std::string program_folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  try {
    companion_program("no_such_program", "EARSHOT_TEST_COMPANION");
    FAIL() << "found";
  } catch (const RunError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("no_such_program: is neither in " + program_folder),
                                             testing::HasSubstr("set EARSHOT_TEST_COMPANION to its path")));
  }
}

}  // namespace
}  // namespace earshot
